p8
CURRENT JOINT POSITION:
 Joint  1: -37.396
 Joint  2: -36.571
 Joint  3: 22.831
 Joint  4: 122.530
 Joint  5: 32.939
 Joint  6: 228.764
p9
CURRENT JOINT POSITION:
 Joint  1: 29.918
 Joint  2: -45.724
 Joint  3: 79.470
 Joint  4: -182.359
 Joint  5: -85.304
 Joint  6: -261.126
p10
CURRENT JOINT POSITION:
 Joint  1: -8.214
 Joint  2: -66.135
 Joint  3: -50.549
 Joint  4: -95.213
 Joint  5: 36.519
 Joint  6: 132.290
p11
CURRENT JOINT POSITION:
 Joint  1: 79.912
 Joint  2: -75.836
 Joint  3: -85.429
 Joint  4: 165.077
 Joint  5: 31.640
 Joint  6: -22.555
