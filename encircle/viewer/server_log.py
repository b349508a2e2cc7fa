"""What tornado says: what matters in one line, and nothing of requests that others get wrong."""

import logging

from encircle.protocol.process.log import say_error


class _Lines(logging.Handler):
    """What goes wrong in the server, in one line each."""

    def emit(self, record: logging.LogRecord) -> None:
        cause = record.exc_info[1] if record.exc_info else None
        text = record.getMessage().partition("\n")[0]
        say_error(f"page: {text}" + (f": {cause}" if cause else ""))


def quiet_tornado() -> None:
    """Have tornado say what matters in one line, and nothing of requests that others get wrong."""
    for name in ("tornado.access", "tornado.general", "tornado.application"):
        logger = logging.getLogger(name)
        logger.propagate = False
        if not logger.handlers:
            is_ours = name == "tornado.application"
            logger.addHandler(_Lines() if is_ours else logging.NullHandler())
