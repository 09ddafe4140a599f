ROB_1 Joint 1 position (deg)	ROB_1 Joint 2 position (deg)	ROB_1 Joint 3 position (deg)	ROB_1 Joint 4 position (deg)	ROB_1 Joint 5 position (deg)	ROB_1 Joint 6 position (deg)
-37.396	-36.571	22.831	122.530	32.939	228.764
29.918	-45.724	79.470	-182.359	-85.304	-261.126
-8.214	-66.135	-50.549	-95.213	36.519	132.290
79.912	-75.836	-85.429	165.077	31.640	-22.555
