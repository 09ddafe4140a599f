/PROG CAL
/MN
 1:J P[1] 10% FINE ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 1,
	J1= -37.396 deg,	J2= -36.571 deg,	J3= 22.831 deg,	J4= 122.530 deg,	J5= 32.939 deg,	J6= 228.764 deg
};
P[2]{
   GP1:
	UF : 0, UT : 1,
	J1= 29.918 deg,	J2= -45.724 deg,	J3= 79.470 deg,	J4= -182.359 deg,	J5= -85.304 deg,	J6= -261.126 deg
};
P[3]{
   GP1:
	UF : 0, UT : 1,
	J1= -8.214 deg,	J2= -66.135 deg,	J3= -50.549 deg,	J4= -95.213 deg,	J5= 36.519 deg,	J6= 132.290 deg
};
P[4]{
   GP1:
	UF : 0, UT : 1,
	J1= 79.912 deg,	J2= -75.836 deg,	J3= -85.429 deg,	J4= 165.077 deg,	J5= 31.640 deg,	J6= -22.555 deg
};
/END
