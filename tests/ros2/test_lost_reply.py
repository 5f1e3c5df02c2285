"""A reply whose datagram is lost comes again, with a program that was built by bridge/patches/cargo."""

import os
import subprocess
import time

import programs
import pytest
import wire
from programs import wait_for


@pytest.mark.skipif("SIDEHILL_PATCHED" not in os.environ, reason="SIDEHILL_PATCHED names no patched program")
def test_the_first_reply_of_a_service_is_not_lost_with_its_datagram(start, peer, tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "SIDEHILL", os.environ["SIDEHILL_PATCHED"])
    library, muted = tmp_path / "muted.so", tmp_path / "muted"
    source = os.path.join(os.path.dirname(__file__), "muted.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    muted.write_bytes(b"\0")
    start("run", programs.adapted("run_ros2.yaml", {}, tmp_path), LD_PRELOAD=str(library), MUTED=str(muted))
    client = peer.client("/controller_server/get_state", wire.GetState)
    time.sleep(1.0)
    with open(muted, "r+b", buffering=0) as switch:
        switch.write(b"\1")
        number = client.send()
        time.sleep(0.5)
        assert not client.reply(number)
        switch.seek(0)
        switch.write(b"\0")
    wait_for(lambda: client.reply(number), "the reply")
