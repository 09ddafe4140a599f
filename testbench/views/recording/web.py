"""Rerun's own web viewer: the rerun program carries its files, and hands them to a server of ours."""

import http.client
import json

from testbench.views.recording.viewer import HERE, check_runs, free_port, started, wait

START = 30.0  #: Longest wait for the program, and for a file of it [s].
FILES = ("", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""What its page consists of, the page first."""
NOTHING = f"http://{HERE}/none.rrd"
"""A recording to be opened by its address: without one the program listens for readings too."""


def web_viewer() -> dict[str, bytes]:
    """Its files by name, the page as the empty one.

    Raises:
        BenchError: When the program fails.
    """
    port = free_port()
    flags = [NOTHING, "--serve-web", "--web-viewer-port", str(port), "--port", "auto"]
    with started(flags, {}) as process:

        def asked() -> dict[str, bytes] | None:
            check_runs(process)
            try:
                return {name: _get(port, name) for name in FILES}
            except OSError:  # it is not listening yet
                return None

        return wait(asked, START, f"the web viewer did not answer in {START:g} s")


def opener(recording: str, viewer: str) -> bytes:
    """A page that opens a recording in the web viewer, which asks for whole addresses.

    Args:
        recording: Path of the recording beside this page.
        viewer: Path of the viewer's page beside it.
    """
    whole = f"new URL({json.dumps(recording)}, location.href).href"
    to = f"{json.dumps(viewer)} + '?url=' + encodeURIComponent({whole})"
    head = '<!doctype html><meta charset="utf-8"><title>Recording</title>'
    return f"{head}<script>location.replace({to})</script>".encode()


def _get(port: int, name: str) -> bytes:
    connection = http.client.HTTPConnection(HERE, port, timeout=START)
    try:
        connection.request("GET", f"/{name}")
        answer = connection.getresponse()
        content = answer.read()
        if answer.status != http.HTTPStatus.OK:
            raise OSError(f"{name}: {answer.status}")
        return content
    finally:
        connection.close()
