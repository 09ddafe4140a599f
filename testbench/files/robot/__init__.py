"""Import of a robot from URDF or MJCF: read, reduced to one serial chain, written as rigid.xml."""
