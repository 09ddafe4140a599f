"""The address of a cluster: encrypted, or on this machine, or said aloud to be insecure."""

import socket
import threading
from functools import partial

import dask
import pytest
from run_here import here

from testbench.errors import BenchError
from testbench.runs.engine import check_address, on_cluster, on_cores
from testbench.studies.campaign.gravity_calibration import STUDY
from testbench.studies.run import app, choose_backend
from testbench.workflows.options import Common

SAFE = """tls://cluster.example:8786 tls://[2001:db8::1]:8786 tcp://127.1.2.3:8786 tcp://[::1]:8786
    tcp://localhost:8786""".split()
PLAIN = "tcp://10.0.0.7:8786 tcp://0.0.0.0:8786 tcp://127.0.0.1.example:1".split()
NONE = """cluster:8786 tls://:8786 tls://host tls://host:port ws://127.0.0.1:1 tls://user@host:8786
    tls://host:8786/path tls://host:8786?x tls://host:8786#x""".split()


@pytest.mark.parametrize("address", [*SAFE, *PLAIN, *NONE])
def test_an_address_is_encrypted_or_of_this_machine_or_said_aloud_to_be_insecure(address):
    if address not in SAFE:
        said = "--insecure" if address in PLAIN else "--cluster: expected tls://host:port"
        with pytest.raises(BenchError, match=said) as caught:
            check_address(address, insecure=address in NONE)
        assert "\n" not in str(caught.value)
    if address not in NONE:
        check_address(address, insecure=address in PLAIN)


def no_work(seeds):
    return [[] for _ in seeds]


def connect(address):
    return next(on_cluster(no_work, iter([(1,)]), address=address, patience=0.5))


def reply(stranger):
    caller, _ = stranger.accept()
    with caller:
        caller.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" * 9)
        while caller.recv(4096):  # until the caller goes
            pass


def test_a_port_where_somebody_else_listens_is_told():
    with socket.create_server(("127.0.0.1", 0)) as stranger:
        thread = threading.Thread(target=reply, args=(stranger,))
        thread.start()
        address = f"tcp://127.0.0.1:{stranger.getsockname()[1]}"
        with pytest.raises(BenchError, match=f"no scheduler answers at {address}$"):
            connect(address)
        thread.join()


def test_the_command_line_chooses_one_backend():
    assert choose_backend(Common(workers=3)).func is on_cores
    chosen = choose_backend(Common(cluster="tcp://10.0.0.7:1", insecure=True))
    assert (chosen.func, chosen.keywords) == (on_cluster, {"address": "tcp://10.0.0.7:1", "insecure": True})
    with pytest.raises(BenchError, match="cannot be combined with --cluster"):
        choose_backend(Common(workers=2, cluster="tls://host:1"))
    with pytest.raises(BenchError, match="--insecure"):
        choose_backend(Common(cluster="tcp://host:1"))


def test_certificates_are_asked_for_whatever_there_is_to_do(tmp_path):
    tls = "distributed.comm.tls"
    every = (f"{tls}.ca-file", f"{tls}.client.cert", f"{tls}.client.key")
    for file, said in (
        (None, "tls://192.0.2.1:1 needs certificates: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE"),
        (str(tmp_path / "none.pem"), "--cluster: certificates: .*No such file"),
    ):
        for ask in (connect, lambda address: choose_backend(Common(cluster=address))):
            with dask.config.set(dict.fromkeys(every, file)), pytest.raises(BenchError, match=said):
                ask("tls://192.0.2.1:1")


def test_a_study_of_one_chunk_goes_to_the_cluster_that_is_asked_for(tmp_path, monkeypatch):
    """It was done here, in silence, however wrong the address; nobody listens there."""
    monkeypatch.setattr("testbench.studies.run.on_cluster", partial(on_cluster, patience=0.3))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        done = here(app(STUDY), "--quick", "--seeds", 1, "--cluster", nobody, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (2, f"error: --cluster: no scheduler answers at {nobody}\n")
    assert not (tmp_path / "out").exists()
