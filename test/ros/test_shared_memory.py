"""Which leftovers of killed programs are cleared away; test_executables.py starts a node in spite of one."""

import threading

from plsing_ros.nodes.shared_memory import clear_half_made_ports

MADE, BEING_MADE = b"\2\0\0\0", b"\1\0\0\0"


def leave(path, content):
    path.write_bytes(content)
    return path


def test_only_ports_that_stay_half_made_are_cleared_away(tmp_path, capfd):
    gone = [
        leave(tmp_path / "fastrtps_port7669", BEING_MADE + bytes(52396)),
        leave(tmp_path / "fastrtps_port7000", b""),
    ]
    in_the_making = leave(tmp_path / "fastrtps_port7663", BEING_MADE)
    kept = [
        in_the_making,
        leave(tmp_path / "fastrtps_port7661", MADE + bytes(52396)),
        leave(tmp_path / "fastrtps_port7661_el", b""),
        leave(tmp_path / "fastrtps_00aa11bb22cc33d4", BEING_MADE),
        leave(tmp_path / "somebody_elses", b""),
    ]
    maker = threading.Timer(0.1, in_the_making.write_bytes, [MADE])
    maker.start()
    clear_half_made_ports(tmp_path)
    maker.join()
    assert sorted(tmp_path.iterdir()) == sorted(kept)
    said = capfd.readouterr().err
    assert all(f"{path} was left half made" in said for path in gone)
    assert not any(f"{path} was" in said for path in kept)


def test_nothing_half_made_is_nothing_said(tmp_path, capfd):
    leave(tmp_path / "fastrtps_port7661", MADE)
    clear_half_made_ports(tmp_path)
    clear_half_made_ports(tmp_path / "nowhere")
    assert capfd.readouterr().err == ""
