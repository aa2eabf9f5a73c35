(Four arcs of 270 degrees, radius 400 steps; M0 waits for the button: cycle start)
M0
G21 G90 G17 F15000
G3 X-400 Y400 I0 J400
G3 X0 Y0 I0 J-400
G2 X400 Y-400 I400 J0
G2 X0 Y0 I-400 J0
M2
