"""Scenarios: the shipped ones load, and what is wrong in one is said in one sentence."""

from dataclasses import fields, is_dataclass

import pytest

from emulator import ScenarioError
from emulator.motion.hand_motion import MotionSettings
from emulator.scenario import MAX_FILE_BYTES, Scenario, load_scenario, scenario_names


def write(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", scenario_names())
def test_every_shipped_scenario_loads_and_says_what_it_is_for(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert 20 < len(scenario.purpose) <= 120
    assert "\n" not in scenario.purpose


def test_a_dozen_ship_and_no_two_are_the_same():
    scenarios = [load_scenario(name) for name in scenario_names()]
    assert len(scenarios) >= 12
    assert len({s.purpose for s in scenarios}) == len(scenarios)


def test_the_default_is_what_it_says():
    default = load_scenario("default")
    motion, drift = default.motion, default.drift
    assert (motion.shape, motion.period_s, motion.swing_deg, motion.cycles) == ("cosine", 4.0, 40.0, 12)
    assert (drift.mode, drift.angle_deg, default.device.rate_hz) == ("constant", 0.8, 100)
    assert default.imu.heading_drift_deg_per_min > 0.0


def test_a_scenario_from_a_file(tmp_path):
    scenario = load_scenario(write(tmp_path, "seed = 7\n[motion]\nperiod_s = 3\naxis = [0, 1, 0]\n"))
    assert (scenario.name, scenario.seed, scenario.motion.period_s) == ("mine", 7, 3.0)
    assert scenario.motion.axis == (0.0, 1.0, 0.0)
    assert scenario.device == Scenario().device


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[motion]\nperoid_s = 3", "unknown key motion.peroid_s: did you mean 'period_s'?"),
        ("[wobble]\nx = 3", "unknown key wobble: known keys: "),
        ("[motion]\nperiod_s = 0.1", "motion.period_s must be a number from 0.2 to 600, not 0.1"),
        ("[motion]\nperiod_s = nan", "motion.period_s must be a number from 0.2 to 600, not nan"),
        ("[motion]\nperiod_s = true", "motion.period_s must be a number"),
        ("[motion]\nperiod_s = '4'", "motion.period_s must be a number"),
        ("[motion]\ncycles = 2.5", "motion.cycles must be a whole number from 0 to 100000, not 2.5"),
        (
            "[motion]\nshape = 'square'",
            "motion.shape must be one of cosine, trapezoid, two-hump, double-peak, not 'square'",
        ),
        ("[motion]\nshape = ['cosine']", "motion.shape must be one of"),
        ("[motion]\naxis = [1, 1, 0]", "motion.axis must have length 1 within 0.01, not 1.4142"),
        ("[motion]\naxis = [1, 0]", "motion.axis must be a list of 3 numbers"),
        ("[motion]\nshape='two-hump'\nsaddle_height = 0.8", "motion.saddle_height must be below second_height (0.7)"),
        ("motion = 3", "motion must be a table: write [motion]"),
        ("[drift]\nmode = 'slip'\nslip_cycle = 12", "drift.slip_cycle must be below motion.cycles (12)"),
        ("[device]\nrate_hz = 2000", "device.rate_hz must be a whole number from 10 to 1000, not 2000"),
        ('[device]\nname = "a\\u001b[31m"', "device.name must be printable text of at most 32 bytes"),
        ("[device]\nanswers = false", "device.answers = false needs streams_from_power_up = true"),
        ("[device]\nanswers = 0", "device.answers must be true or false"),
        ("[device]\nanswers = false\nstreams_from_power_up = true", 'needs motion.begins = "at-power-up"'),
        ("[device.card]\nweights = 3", "device.card.weights must be a list of tables: write [[device.card.weights]]"),
        ("[[device.card.weights]]\nslot = 256", "device.card.weights.slot must be a whole number from 0 to 255"),
        ("seed = -1", "seed must be a whole number from 0 to"),
        ("seed = 1\nseed = 2", "is not TOML: "),
        ("name = 'x'", "unknown key name"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, text, says):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(write(tmp_path, text))
    assert says in str(caught.value)
    assert "mine.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_scenario_lists_all():
    with pytest.raises(ScenarioError) as caught:
        load_scenario("defualt")
    for name in scenario_names():
        assert name in str(caught.value)


def test_files_that_are_no_scenario(tmp_path):
    big = tmp_path / "big.toml"
    big.write_text("# " + "x" * MAX_FILE_BYTES)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    deep = tmp_path / "deep.toml"
    deep.write_text("x = " + "[" * 40_000)
    for path, says in [
        (big, "larger than"),
        (binary, "is not TOML"),
        (deep, "is not TOML"),
        (tmp_path, "cannot read scenario"),
        (tmp_path / "none.toml", "No such file"),
    ]:
        with pytest.raises(ScenarioError, match=says):
            load_scenario(path)


def test_values_from_code_are_checked_too():
    with pytest.raises(ScenarioError, match="swing_deg must be"):
        MotionSettings(swing_deg=-3.0)


def test_every_field_has_a_rule_or_is_the_name():
    def check(cls):
        for field in fields(cls):
            rule = field.metadata.get("rule")
            assert rule is not None or field.name == "name", f"{cls.__name__}.{field.name} is not checked"
            if is_dataclass(getattr(rule, "cls", None)):
                check(rule.cls)

    check(Scenario)
