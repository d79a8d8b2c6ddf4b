"""Tests of the reactors, in virtual time, without waiting: python -m pytest."""

from new_project.app import Filter, Sensor


def test_the_filter_gives_the_mean_of_the_last_readings(run_reactor):
    readings = [("0 ms", 4), ("10 ms", 8), ("20 ms", 20)]
    result = run_reactor(Filter(size=2), inputs={"reading": readings})
    assert result.outputs["mean"] == [(0, 4.0), (10_000_000, 6.0), (20_000_000, 14.0)]


def test_the_sensor_reads_ten_times_a_second(run_reactor):
    result = run_reactor(Sensor(), timeout="200 ms")
    assert result.outputs["reading"] == [(0, 1), (100_000_000, 2), (200_000_000, 3)]
