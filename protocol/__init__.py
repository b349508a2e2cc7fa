"""What robots and world exchange: messages, codec, keys, connections, the lock-step table.

Nothing here decides anything about a hunt. The modules are usable on their own by a robot or a
viewer of another project; ``docs/protocol.md`` is the reference for those in other languages.
"""

VERSION = 4
"""Version of the wire format, carried as ``v`` in every message."""

if __name__ != "encircle.protocol":
    raise ImportError(
        "the package is imported as encircle.protocol, not as protocol", name=__name__
    )
