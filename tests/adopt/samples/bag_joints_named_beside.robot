Time,name_0,name_1,name_2,name_3,name_4,name_5,position_0,position_1,position_2,position_3,position_4,position_5,velocity_0,velocity_1,velocity_2,velocity_3,velocity_4,velocity_5
0.000,joint_3,joint_2,joint_1,joint_4,joint_5,joint_6,0.398476122,-0.638284361,-0.652683327,2.138551932,0.574894002,3.992685010,0.0,0.0,0.0,0.0,0.0,0.0
0.100,joint_3,joint_2,joint_1,joint_4,joint_5,joint_6,1.387013157,-0.798034347,0.522167606,-3.182764971,-1.488835665,-4.557508463,0.0,0.0,0.0,0.0,0.0,0.0
0.200,joint_3,joint_2,joint_1,joint_4,joint_5,joint_6,-0.882246484,-1.154273501,-0.143361345,-1.661780341,0.637376790,2.308896067,0.0,0.0,0.0,0.0,0.0,0.0
0.300,joint_3,joint_2,joint_1,joint_4,joint_5,joint_6,-1.491017327,-1.323587892,1.394727512,2.881137169,0.552222175,-0.393659013,0.0,0.0,0.0,0.0,0.0,0.0
