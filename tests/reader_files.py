"""Files of one known motion in the text layouts of the readers, written by plain formatting."""

import numpy as np
from scipy.spatial.transform import Rotation

RATE_HZ = 100.0


def motion(n=400, seed=1):
    """Times from 100 s on, poses, and positions in m; no Euler angle near its limits."""
    times = 100.0 + np.arange(n) / RATE_HZ
    swing = np.sin(2 * np.pi * (times - 100.0) / 2.0)[:, None] * [[0.3, 0.5, -0.2]]
    poses = Rotation.from_rotvec(swing) * Rotation.from_rotvec([0.2, -0.1, 0.4])
    positions = 0.01 * np.random.default_rng(seed).normal(size=(n, 3)).cumsum(axis=0)
    return times, poses, positions


def rows_text(table, header=None, end=""):
    lines = [",".join(repr(float(cell)) for cell in row) + end for row in table]
    return "\n".join(([header] if header else []) + lines) + "\n"


def t42(path, *, quaternion=False, degrees=False, n=400):
    times, poses, positions = motion(n)
    angles = poses.as_euler("xyz", degrees=degrees)
    columns = [np.arange(n), times, *positions.T, *angles.T]
    header = ",ts,tx,ty,tz,rx,ry,rz"
    if quaternion:
        columns += list(poses.as_quat().T)
        header += ",qx,qy,qz,qw"
    columns += [np.full(n, 1784), np.full(n, 4117)]
    path.write_text(rows_text(np.stack(columns, axis=1), header + ",motor0,motor1"))
    return times, poses, positions


def ndx(path, *, trailing_comma=True, n=400):
    times, poses, positions = motion(n)
    angles = poses.as_euler("ZYX", degrees=True)
    rows = [
        "1," + ",".join(f"{v: .12f}" for v in (*p / 0.0254, *a)) + ("," if trailing_comma else "")
        for p, a in zip(positions, angles, strict=True)
    ]
    path.write_text("\n".join(rows) + "\n")
    return times, poses, positions


def tum(path, n=400):
    times, poses, positions = motion(n)
    table = np.column_stack((times, positions, poses.as_quat()))
    lines = [" ".join(repr(float(v)) for v in row) for row in table]
    path.write_text("# a comment\n" + "\n".join(lines) + "\n")
    return times, poses, positions


def named(path, header="time,w,x,y,z", n=400, quats=None, delimiter=",", times=None):
    own_times, poses, positions = motion(n)
    quats = poses.as_quat(scalar_first=True) if quats is None else quats
    table = np.column_stack((own_times if times is None else times, quats))
    text = rows_text(table, header).replace(",", delimiter)
    path.write_text(text)
    return own_times, poses, positions
