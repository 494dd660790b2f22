"""The bench: what is placed can be seen at once."""

from tests.daemon.small import small_daemon


def test_the_twins_specimen_is_rendered_when_it_is_placed(tmp_path, monkeypatch):
    def late(*_):
        raise AssertionError("rendered while a camera waits")

    with small_daemon(tmp_path, sensor_px=160) as daemon:
        world = daemon.bench.world
        assert daemon.bench.place("membrane") == ""
        monkeypatch.setattr("drivers.twin.world.render_scene", late)
        assert world.irradiance("primary").shape == (128, 160)
