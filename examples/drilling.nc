(Eight holes in a plate, with a clamp 12 mm high across its middle, at X 30)
G21 G90 G17 G94 G54
M3 S8000
G0 Z15
(from hole to hole at R)
G99 G81 X5 Y5 Z-6 R2 F300
Y25
X20
(after this one up, over the clamp)
G98 Y5
(from hole to hole at R again)
G99 X40
Y25
X55
(up in the end)
G98 Y5
G80
M5
M30
