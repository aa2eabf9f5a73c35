(Four holes of a cover: as an old post-processor writes it.)
G0 G49 G40 G17 G80 G50 G90
M6 T0
G20 (inch)
M03 S500
M08
G90
G00 G43 H0 Z0.1
G73 X-7 Y-4 Z-0.75 Q0.2 R0.1 F10
X-5.9
X-4.8
X-3.7
G80
M5 M9
X-7 Y-4
M30
