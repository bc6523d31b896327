"""Recordings of emulated objects with their cards, in folders as a person would keep them."""

from dataclasses import replace

from emulator.device.settings import CardSettings, WeightSettings
from tests.recorded_trials import scenario, virtual_chunks, write_recording

OBJECTS = {
    "cube": CardSettings(shape="cube", size_mm=(60.0, 60.0, 60.0), mass_g=142.5, weights=(WeightSettings(1, 20.0),)),
    "cylinder": CardSettings(
        shape="cylinder", size_mm=(55.0, 80.0, float("nan")), mass_g=151.0, com_mm=(0.0, 0.0, 2.0)
    ),
    "sphere": CardSettings(shape="sphere", size_mm=(70.0, float("nan"), float("nan")), mass_g=139.0),
}
MOTIONS = {"roll": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0)}

HAND = """[hand]
model = "{model}"
maker = "laboratory"
fingers = 2
actuation = "2 motors, tendons, underactuated"
aperture_mm = 90.0
aperture_measured = "calliper between the fingertips, fully open"
fingertip_material = "urethane rubber"
control_mode = "open loop, position"
control_rate_hz = 50.0
set_points = "both motors, sine"
software = "controller 1.0"
"""
TRIAL = """[trial]
motion = "{motion}"
axis = "world {axis}"
protocol = "P19-0838.3"
repeats = {cycles}
operator = "emulator"
comments = "An emulated trial: the drift is known and built in. The open-loop hand does not correct it."
"""


def write_trials(folder, model="T42", objects=("cube",), motions=("roll",), cycles=6, theta_deg=0.6):
    """Write ``<object>_<motion>.mcap`` with ``.toml`` beside it, and ``hand.toml``; return paths and truths."""
    folder.mkdir(parents=True)
    (folder / "hand.toml").write_text(HAND.format(model=model))
    paths, truths = [], {}
    for number, name in enumerate(objects):
        for place, motion in enumerate(motions):
            chosen = scenario(
                "default",
                motion={"cycles": cycles, "axis": MOTIONS[motion]},
                drift={
                    "mode": "random-walk",
                    "angle_deg": theta_deg * (1 + 0.5 * number + 0.25 * place),
                    "scatter_deg": 0.15,
                },
                device={"name": f"virtual {name}", "device_id": 0xA0 + number, "card": OBJECTS[name]},
            )
            chunks, truth = virtual_chunks(replace(chosen, seed=number * 10 + place), seed=number * 10 + place + 1)
            path = write_recording(folder / f"{name}_{motion}.mcap", chunks)
            axis = "x" if motion == "roll" else "y"
            path.with_suffix(".toml").write_text(TRIAL.format(motion=motion, axis=axis, cycles=cycles))
            paths.append(path)
            truths[path.name] = truth
    return paths, truths
