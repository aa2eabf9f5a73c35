(Bracket with a pocket: the program is its contour, G41 leads a cutter of 6 mm beside it)
G21 G90 G17 G94 G54
M3 S10000
G0 Z5
(outside, clockwise: the cutter is on the left)
G0 X0 Y0
G1 Z-2 F300
G41.1 D6
G1 X12 Y0 F800
G1 Y48
G2 X22 Y58 I10 J0
G1 X52
Y33
X87
Y18
G2 X77 Y8 I-10 J0
G1 X4
G40 G1 X0 Y0
G0 Z5
(the pocket, counter-clockwise: the cutter is on the left again, and inside)
G0 X32 Y30
G1 Z-2 F300
G41.1 D6
G1 X26 Y22 F800
G3 X32 Y16 I6 J0
G1 X38
G3 X44 Y22 I0 J6
G1 Y38
G3 X38 Y44 I-6 J0
G1 X26
G3 X20 Y38 I0 J-6
G1 Y22
G3 X26 Y16 I6 J0
G1 X32
G3 X38 Y22 I0 J6
G40 G1 X32 Y30
G0 Z5
M5
M30
