"""The arena: physics, sensing, target behaviours and the radio, and the process that runs them.

``engine`` is pure: state and commands in, state and observations out. ``core`` speaks the protocol
around it without I/O; ``server`` is the process. ``python -m encircle.world SCENARIO --listen E
--run R`` starts one.
"""

if __name__ != "encircle.world":
    raise ImportError("the package is imported as encircle.world, not as world", name=__name__)
