"""What an arm's MJCF may say: elements, their attributes, how large a number may be."""

PLACED = "pos quat axisangle euler xyaxes zaxis"
ATTRIBUTES = {
    element: frozenset(attributes.split())
    for element, attributes in {
        "mujoco": "model",
        "compiler": "angle autolimits inertiafromgeom meshdir",
        "option": "gravity jacobian timestep integrator cone solver iterations tolerance",
        "flag": "contact filterparent midphase nativeccd multiccd energy",
        "visual": "",
        "global": "fovy ipd azimuth elevation linewidth glow realtime offwidth offheight ellipsoidinertia"
        " bvactive cameraid orthographic treedepth",
        "quality": "shadowsize offsamples numslices numstacks numquads",
        "headlight": "ambient diffuse specular active",
        "map": "stiffness stiffnessrot force torque alpha fogstart fogend znear zfar haze shadowclip"
        " shadowscale actuatortendon",
        "scale": "forcewidth contactwidth contactheight connect com camera light selectpoint jointlength"
        " jointwidth actuatorlength actuatorwidth framelength framewidth constraint slidercrank frustum",
        "rgba": "fog haze force inertia joint actuator actuatornegative actuatorpositive com camera light"
        " selectpoint connect contactpoint contactforce contactfriction contacttorque contactgap rangefinder"
        " constraint slidercrank crankbroken frustum bv bvactive",
        "statistic": "meaninertia meanmass meansize extent center",
        "asset": "",
        "material": "name class rgba emission specular shininess reflectance metallic roughness",
        "mesh": "name class file scale refpos refquat inertia smoothnormal maxhullvert vertex normal face",
        "default": "class",
        "worldbody": "",
        "body": f"name childclass {PLACED}",
        "inertial": f"mass diaginertia fullinertia {PLACED}",
        "joint": "name type axis pos range limited armature damping group",
        "geom": "name class type contype conaffinity condim group priority size material rgba friction mass"
        f" density shellinertia solmix solref solimp margin gap fromto mesh fitscale {PLACED}",
        "light": "name class mode target type directional castshadow active pos dir ambient diffuse specular"
        " attenuation cutoff exponent bulbradius intensity range",
        "camera": f"name class mode target fovy ipd projection orthographic {PLACED}",
        "contact": "",
        "exclude": "name body1 body2",
    }.items()
}
"""No file but meshes, nothing that grows, no wind, no gravcomp, gravity never off."""
WORDS = frozenset(
    "model angle autolimits inertiafromgeom meshdir jacobian integrator cone solver"
    " contact filterparent midphase nativeccd multiccd energy ellipsoidinertia bvactive orthographic"
    " name class childclass file smoothnormal type limited material shellinertia mesh mode target"
    " directional castshadow active projection body1 body2".split()
)
"""Attributes of words; all others are numbers."""
ALSO_WORDS = frozenset({("mesh", "inertia"), ("headlight", "active")})
LONGEST = 1000  #: Characters of a word.

NUMBERS = {
    **{"pos": 3, "quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3},
    **{"diaginertia": 3, "fullinertia": 6},
}
"""How many numbers place a body or give its inertia."""
LARGEST = 1e6  #: Largest angle, mass or inertia of an arm; beyond it an exponent is a slip.
LENGTH = 1000.0  #: Largest length [m].
LARGEST_OF = {
    **dict.fromkeys(("pos", "size", "fromto", "margin", "gap", "refpos", "extent", "center"), LENGTH),
    **dict.fromkeys(("offwidth", "offheight", "shadowsize"), 16384.0),
    **dict.fromkeys(("offsamples", "numslices", "numstacks", "numquads"), 1000.0),
    **dict.fromkeys(("contype", "conaffinity"), 2.0**32),
    "density": 1e5,  # five times the densest metal [kg/m^3]
}
"""Largest of the numbers of an attribute, where it is not LARGEST."""

MOST_NUMBERS = 12  #: Of an attribute; only a mesh has more.
MOST = 20_000  #: Elements of an arm in all.
MOST_OF = {
    **dict.fromkeys(("body", "mesh", "material", "default", "exclude"), 1000),
    "geom": 2000,
    **dict.fromkeys(("light", "camera"), 100),
}
"""Elements of a kind."""
