"""Zenoh connections of tests, and waiting for what arrives on them."""

import threading
from concurrent.futures import Future

from helpers_waiting import LONGEST_S, result_of

from encircle.protocol.zenoh.endpoints import Endpoints


def listening(endpoint):
    return Endpoints(listen=(endpoint,))


def connecting_to(endpoint, s_max=LONGEST_S):
    return Endpoints(connect=(endpoint,), connect_s_max=s_max)


def in_thread(function, *arguments):
    """A future of the call, on a thread that does not outlive a failed test."""
    future = Future()

    def run():
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future


def received(link, count=1):
    return result_of(in_thread(lambda: [link.receive() for _ in range(count)]))
