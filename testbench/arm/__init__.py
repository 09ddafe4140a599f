"""Description of an arm as its folder states it: bodies, joints, frames, elastic properties.

`load_arm` reads rigid.xml and elastic.toml and checks both; truth and model begin from the same `Arm`.
"""
