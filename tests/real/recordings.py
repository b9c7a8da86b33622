"""The real recordings as bags, for all tests of them."""

from pathlib import Path

from idim_iv_ros import import_table


def emps_bag(data: Path, out: Path) -> Path:
    """EMPS: position, control signal and reference."""
    mat = data / "emps" / "DATA_EMPS.mat"
    import_table(
        out,
        joints=["axis"],
        position=f"{mat}:qm",
        effort=f"{mat}:vir",
        reference=f"{mat}:qg",
        time=f"{mat}:t",
    )
    return out


def tx40_bag(data: Path, out: Path) -> Path:
    """TX40: motor positions and motor torques."""
    folder = data / "staubli_tx40"
    columns = ",".join(f"Joint_{k}" for k in range(1, 7))
    import_table(
        out,
        joints=[f"joint_{k}" for k in range(1, 7)],
        position=f"{folder / 'pos_read_data.csv'}:{columns}",
        effort=f"{folder / 'curr_data.csv'}:{columns}",
        rate=5000.0,
    )
    return out


def double_pendulum_bag(data: Path, out: Path) -> Path:
    """DFKI double pendulum: measured motion and reference."""
    folder = data / "dfki_double_pendulum"
    measured, reference = folder / "measured.csv", folder / "reference.csv"
    import_table(
        out,
        joints=["shoulder", "elbow"],
        position=f"{measured}:pos1,pos2",
        velocity=f"{measured}:vel1,vel2",
        effort=f"{measured}:tau1,tau2",
        time=f"{measured}:time",
        reference=f"{reference}:pos1,pos2",
        velocity_reference=f"{reference}:vel1,vel2",
        reference_time=f"{reference}:time",
    )
    return out
