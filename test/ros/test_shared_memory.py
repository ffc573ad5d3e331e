# SPDX-License-Identifier: Apache-2.0
"""Which leftovers of killed programs are cleared away; test_executables.py starts nodes beside some."""

import mmap
import os
import threading

import pytest
from messages import mentions

from plsing_ros.errors import StartError
from plsing_ros.nodes.shared_memory import clear_half_made_ports

MADE, BEING_MADE = b"\2\0\0\0", b"\1\0\0\0"


def leave(path, content):
    path.write_bytes(content)
    return path


def test_only_ports_of_the_domain_that_stay_half_made_are_cleared_away(tmp_path, capfd):
    gone = [
        leave(tmp_path / "fastrtps_port7669", BEING_MADE + bytes(52396)),
        leave(tmp_path / "fastrtps_port7650", b""),
    ]
    in_the_making = leave(tmp_path / "fastrtps_port7663", BEING_MADE)
    kept = [
        in_the_making,
        leave(tmp_path / "fastrtps_port7661", MADE + bytes(52396)),
        leave(tmp_path / "fastrtps_port7900", BEING_MADE),  # of domain 2
        leave(tmp_path / "fastrtps_port7661_el", b""),
        leave(tmp_path / "fastrtps_00aa11bb22cc33d4", BEING_MADE),
        leave(tmp_path / "somebody_elses", b""),
    ]
    maker = threading.Timer(0.1, in_the_making.write_bytes, [MADE])
    maker.start()
    clear_half_made_ports(1, tmp_path)
    maker.join()
    assert sorted(tmp_path.iterdir()) == sorted(kept)
    said = capfd.readouterr().err
    assert all(mentions(said, path, "half made", "no living process") for path in gone)
    assert not any(f"{path} was" in said for path in kept)


@pytest.mark.parametrize("seen", [True, False], ids=["seen", "in another container"])
@pytest.mark.parametrize("use", ["open", "mapped"])
def test_a_file_that_a_living_process_has_open_stays_and_is_named(tmp_path, use, seen):
    path = leave(tmp_path / "fastrtps_port7412", BEING_MADE + bytes(4092))
    options = {} if seen else {"processes": tmp_path / "nowhere"}
    file = path.open("r+b")
    mapping = mmap.mmap(file.fileno(), 4096) if use == "mapped" else None
    if mapping is not None:
        file.close()
    with pytest.raises(StartError) as caught:
        clear_half_made_ports(0, tmp_path, **options)
    (mapping or file).close()
    assert str(path) in str(caught.value) and "without end" in str(caught.value)
    assert (f"process {os.getpid()} " in str(caught.value)) is seen
    assert path.exists()
    clear_half_made_ports(0, tmp_path)
    assert not path.exists()


def test_nothing_half_made_is_nothing_said(tmp_path, capfd):
    leave(tmp_path / "fastrtps_port7661", MADE)
    clear_half_made_ports(1, tmp_path)
    clear_half_made_ports(1, tmp_path / "nowhere")
    assert capfd.readouterr().err == ""
