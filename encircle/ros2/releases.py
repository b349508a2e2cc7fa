"""What differs between the releases of ROS 2 that have rmw_zenoh.

Humble knows no hashes of types, so that a constant word stands where others have the hash. Packages
of rmw_zenoh_cpp before 0.1.2 (Humble) and 0.2.4 (Jazzy) wrote the fields of an attachment with
their names; all later ones, and Kilted and what came after it from the start, write them by
position. Of Rolling no fixed set of messages exists; it is taken to have those of Lyrical.
"""

from dataclasses import dataclass

NO_HASH = "TypeHashNotSupported"


@dataclass(frozen=True, slots=True)
class Release:
    """A release of ROS 2.

    ``store``: what rosbags calls its set of messages. ``has_hashes``: whether keys end in the hash
    of the message's type.
    """

    name: str
    store: str
    has_hashes: bool = True


RELEASES = {
    release.name: release
    for release in (
        Release("humble", "ros2_humble", has_hashes=False),
        Release("jazzy", "ros2_jazzy"),
        Release("kilted", "ros2_kilted"),
        Release("lyrical", "ros2_lyrical"),
        Release("rolling", "ros2_lyrical"),
    )
}
DEFAULT_RELEASE = "jazzy"
