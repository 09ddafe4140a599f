/PROG CAL
/POS
P[1]{
 GP1:
 J1= -87.750 deg, J2= 1.0 deg
};
/END
