(One hole of each cycle that drills, from the left to the right)
G21 G90 G17 G94 G54 G99
M3 S8000
G0 Z8
G81 X0 Y0 Z-6 R1 F300
(with a dwell of half a second at the bottom)
G82 X8 Z-6 R1 P0.5
(in pecks of 2 mm, out of the hole after each)
G83 X16 Z-6 R1 Q2
(in pecks of 2 mm, lifted by $28 after each)
G73 X24 Z-6 R1 Q2
(out at feed)
G85 X32 Z-6 R1
G80
G0 Z8
M5
M30
