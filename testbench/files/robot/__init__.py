"""A stranger's URDF or MJCF as an arm of ours: read, reduced to one serial chain, written as rigid.xml."""
