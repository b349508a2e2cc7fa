"""The words that only runs by the clock use: names of counts and of a mode, in commands.

A robot counts in ``Command.refused``, beside what it has refused, the observations that it has
passed over because a newer one was there, those that never came, and packets from its peers for
which it had no room. With the first two, the world can tell a command that was lost on its way from
one that was never given.

Commands may be lost, and are so when the network is at its worst. So what a robot has heard, and
when, is told in the order of hearing and told again with every command until an observation says
that a command which told of it has come (``Observation.answered``): nothing is missing that came
before the last that is told. Of an observation it is told, in the place of a sender, whether it was
answered or passed over, after the packets that were heard before.
"""

ANSWERED = "world"

PASSED_OVER = "passed-over"
MISSED = "missed"
OVERHEARD = "overheard"
STOPPED = "stop"
"""Mode of the command that a robot gives, unasked, when no observation comes: it stands still."""
