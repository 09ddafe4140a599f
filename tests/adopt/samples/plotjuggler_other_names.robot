/joint_states/joint_a1/position,/joint_states/joint_a2/position,/joint_states/joint_a3/position,/joint_states/joint_a4/position,/joint_states/joint_a5/position,/joint_states/joint_a6/position,/joint_states/joint_a1/velocity
-37.396,-36.571,22.831,122.530,32.939,228.764,0.5
29.918,-45.724,79.470,-182.359,-85.304,-261.126,0.5
-8.214,-66.135,-50.549,-95.213,36.519,132.290,0.5
79.912,-75.836,-85.429,165.077,31.640,-22.555,0.5