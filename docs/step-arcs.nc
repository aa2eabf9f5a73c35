(Two circles of radius 10 steps: the nearest steps, and the rule of the Pico arc machine)
$790=0
G21 G90 G17 F600
G3 X0 Y0 I-10 J0
G0 X30
$790=1
G3 X30 Y0 I-10 J0
M2
