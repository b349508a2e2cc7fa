"""Limits of what a field may hold."""

TEXT_MAX = 256
"""Characters of a text."""
LIST_MAX = 256
"""Names in a list of robots."""
COUNT_MAX = 2**53 - 1
"""The largest whole number that a double-precision number holds exactly, as do all below it."""
NUMBER_MAX = 1e9
"""Larger numbers are refused: squared and summed they must stay finite and keep their meaning."""
PLACE_MAX = 1e7
"""Of places in m and velocities in m/s that a robot is told of. A scenario places nothing further
out than a hundredth of it. From larger ones a policy's own numbers would soon be ``NUMBER_MAX``,
and a stranger's packet would fail it."""
REASON_MAX = 200
"""Characters of the reason for which a run has ended."""
RAYS_MIN, RAYS_MAX = 8, 360
"""Rays of a range scan."""
RELAYED_MAX = 16
"""Detections by others that one pose packet repeats."""
SAY_BYTES_MAX = 1024
"""Bytes of what a policy says with one pose packet, as msgpack."""
SAY_DEPTH_MAX = 6
"""How deep lists and maps may be nested in it."""
RECEIPTS_MAX = 256
"""Receipts that one command carries."""
