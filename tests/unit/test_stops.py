"""Signals that end a command, waiting for what must not be cut in two."""

import signal
import socket
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from testbench.stops import STOPS, stops_wait


@pytest.mark.parametrize("number", STOPS)
def test_a_stop_waits_for_the_end_of_the_block_whichever_thread_gets_it(number):
    """While another thread runs, the kernel may hand it over there, and Python heeds it in its main one."""
    before, come = signal.signal(number, signal.default_int_handler), threading.Event()
    other, (told, end) = threading.Thread(target=come.wait), socket.socketpair()
    end.setblocking(False)
    wakeup = signal.set_wakeup_fd(end.fileno())
    other.start()
    done = []

    def work():
        with stops_wait():
            signal.pthread_kill(other.ident, number)
            done.append(told.recv(1))  # it is there

    try:
        with pytest.raises(KeyboardInterrupt):
            work()
        assert done == [bytes([number])]
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(number, before)
        come.set()
        other.join()
        told.close()
        end.close()


def test_what_is_ignored_stays_so_and_threads_may_wait_too():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stops_wait():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    with ThreadPoolExecutor() as pool:
        assert pool.submit(stops_wait()(lambda: True)).result()
