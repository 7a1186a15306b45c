"""``wvr view`` serves until it is told to stop."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request

import pytest

pytest.importorskip("websockets")


def test_it_serves_until_ctrl_c():
    """Its address goes to stdout, with the token of the environment; a page of both volumes is there."""
    # Whoever starts the tests may have it not listen.
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from wvr.cli import main; main()"
    command = [sys.executable, "-c", listen, "view", "blobs", "tree", "--dataset-size", "12", "--no-open-browser"]
    environment = {**os.environ, "WVR_VIEW_TOKEN": "a-token-of-my-own"}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            address = process.stdout.readline().strip()
            assert address.startswith("http://127.0.0.1:") and address.endswith("/a-token-of-my-own/")
            opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
            with opener.open(address, timeout=20) as page:
                assert b"viewer" in page.read()
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=30)
            assert process.returncode == 0 and "Traceback" not in said
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a file, a folder of slices or the name of a dataset"),
        (["nowhere"], "nowhere"),
        (["blobs", "--port", "70000"], "port"),
        (["blobs", "--size", "8x8"], "--size is for images"),
        (["blobs", "--dataset-size", "8", "--tolerance", "2", "--no-open-browser"], "tolerance"),
    ],
)
def test_wrong_arguments(run, arguments, message):
    code, out, err = run("view", *arguments)
    assert code in (1, 2) and out == "" and message in err
