# %% [markdown]
# # From two scans to strain over pressure
#
# bscd in a notebook or a script: calibrate from run files, measure a sphere and an inflation, look at the results.
# Open this file in Jupyter (jupytext), VS Code or Spyder and run it cell by cell, or as `python docs/tutorial.py`.
#
# ## Your files
#
# Name your own run files here: what `bscd record` and the scans wrote, or what `bscd import` made of a folder of
# images. Where there are none yet, the digital twin records some below.

# %%
from pathlib import Path

import bscd

folder = Path("tutorial-data")
reference = folder / "reference.h5"  # scan of the cube with the biprism lowered, both cameras
bsc = folder / "bsc.h5"  # the same scan through the biprism
sphere = folder / "sphere.h5"  # a few frames of the speckled sphere, radius known
inflation = folder / "inflation.h5"  # the membrane: frames at rest, then while the pressure rises

sphere_radius_mm = 18.265

# %% [markdown]
# ## No files yet: record them on the digital twin
#
# The twin is the rig of Genovese et al. 2013 with its exact optics, in virtual time. Few positions and few frames
# keep this short (half a minute; results are a little less sure); `config/twin.toml` has the whole experiment. With
# your own files this does nothing.


# %%
def record_on_the_twin() -> None:
    """Scan the cube twice, then record a sphere and an inflation."""
    from bscd.composition import build_devices, build_world
    from bscd.config import parse_config
    from bscd.procedures import Rig, ScanRecipe, home, record_scan
    from bscd.procedures.recording import InflationRecipe, SphereRecipe, record_inflation, record_sphere
    from drivers.clock import VirtualClock

    folder.mkdir(exist_ok=True)
    text = (Path(bscd.__file__).parents[1] / "config/twin.toml").read_text()
    config, clock = parse_config(text), VirtualClock()
    world = build_world(config, clock)
    rig = Rig(
        **build_devices(config, clock, world),
        clock=clock,
        origin_mm=config.scan.origin_mm,
        raised_mm=config.prism.raised_mm,
        lowered_mm=config.prism.lowered_mm,
    )
    rig.connect()
    home(rig)
    # both poses: the face alone calibrates 16 mm across, and the membrane is 30 mm wide
    scan = ScanRecipe(kind="reference", positions=5, step_mm=8.0, frames_per_position=1, poses=("face", "corner"))
    record_scan(rig, scan, config.target.grid(), reference, config_text=text)
    record_scan(rig, scan.model_copy(update={"kind": "bsc"}), config.target.grid(), bsc, config_text=text)
    world.place("sphere")
    record_sphere(rig, SphereRecipe(frames=2, standard_pair=False), sphere, config_text=text)
    world.place("membrane")
    record_inflation(rig, InflationRecipe(rest_frames=3, ramp_s=1.0, hold_s=0.5, top_kpa=13.0), inflation)
    rig.close()
    world.close()


if not inflation.exists():
    record_on_the_twin()

# %% [markdown]
# ## Calibrate
#
# Once for as long as camera and biprism stay where they are. `figures` says what the calibration is worth; keep the
# file, results name it by its checksum.

# %%
from bscd.calibration import Calibration

calibration_file = folder / "calibration.h5"
if not calibration_file.exists():
    bscd.calibrate(reference, bsc, out=calibration_file)

calibration = Calibration.load(calibration_file)
print(f"dots fit the maps within {calibration.figures['map_residual_rms_px']:.4f} px rms")

# %% [markdown]
# ## Check with the sphere
#
# A ball of known radius anywhere in the volume says whether the whole chain is right, without any other truth.

# %%
from bscd.analysis.surface import fit_sphere

with bscd.measure(calibration_file, sphere) as ball:
    points_mm = ball.xyz_mm[-1][ball.valid[-1]]
free = fit_sphere(points_mm)
fixed = fit_sphere(points_mm, radius_mm=sphere_radius_mm)
print(f"radius {free.radius_mm:.3f} mm, nominal {sphere_radius_mm} mm, {len(points_mm)} points")
print(f"distance from the nominal sphere: {fixed.mean_mm:+.4f} +- {fixed.std_mm:.4f} mm")

# %% [markdown]
# ## Measure the inflation
#
# Every setting of `bscd measure` is a keyword (`step_px`, `subset_px`, `region`, `extrapolate`, ...; see
# `docs/measuring.md`). `out` keeps the results; without it they go when `membrane` does.

# %%
results_file = folder / "results.h5"
if results_file.exists():
    membrane = bscd.open_results(results_file)
else:
    membrane = bscd.measure(calibration_file, inflation, out=results_file, step_px=12)
print(membrane)
print(membrane.counts.text(membrane.status_names))

# %% [markdown]
# What you get are arrays over frames and points, NaN where something is not known:

# %%
w_mm = membrane.uvw_mm[:, :, 2]  # (frames, points), out of the membrane's plane
print("frames, points:", w_mm.shape, " at", membrane.pressure_kpa[-1].round(2), "kPa")

# %% [markdown]
# ## As a table
#
# `table()` is a pandas DataFrame, a row for each point of each frame; `table(-1)` that of the last frame alone.

# %%
table = membrane.table()
good = table[table["valid"]]
print(good.loc[good["frame"] == good["frame"].max(), ["x_mm", "z_mm", "w_mm", "e1", "e2", "zncc"]].describe().round(4))

# %% [markdown]
# Strain over pressure: the median over the middle of the membrane, where the strain hardly varies. Strain needs all
# neighbours within the virtual strain gauge, so points near the border have none.

# %%
import numpy as np

last = membrane.frame(-1)
apex = int(np.nanargmax(last.uvw_mm[:, 2]))  # the point that rose highest
reference_mm = last.xyz_mm - last.displacement_mm
near = np.flatnonzero(np.linalg.norm(reference_mm - reference_mm[apex], axis=1) < 4.0)
middle = good[good["point"].isin(near)]
by_frame = middle.groupby("frame").agg(
    pressure_kpa=("pressure_kpa", "first"),
    w_mm=("w_mm", "median"),
    sigma_w_mm=("sigma_dy_mm", "median"),  # w is along the view, the world's y, but for a degree
    e1=("e1", "median"),
    e2=("e2", "median"),
)
by_frame.to_csv(folder / "by_frame.csv")
print(by_frame.round(4).to_string())

# %% [markdown]
# ## Plots

# %%
import matplotlib.pyplot as plt

figure, (rise, strain, shape) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
rise.plot(by_frame["pressure_kpa"], by_frame["w_mm"], ".-")
rise.set(xlabel="pressure (kPa)", ylabel="w (mm)", title="rise of the middle")
strain.plot(by_frame["pressure_kpa"], 100 * by_frame["e1"], ".-", label="e1")
strain.plot(by_frame["pressure_kpa"], 100 * by_frame["e2"], ".-", label="e2")
strain.set(xlabel="pressure (kPa)", ylabel="Green-Lagrange strain (%)", title="strain of the middle")
strain.legend()
now = membrane.table(-1)
now = now[now["valid"]]
drawn = shape.scatter(now["x_mm"], now["z_mm"], c=now["w_mm"], s=9)
shape.set(xlabel="x (mm)", ylabel="z (mm)", title=f"w at {now['pressure_kpa'].iloc[0]:.1f} kPa", aspect="equal")
figure.colorbar(drawn, ax=shape, label="w (mm)")
figure.savefig(folder / "strain_over_pressure.png", dpi=150)
plt.close(figure)

# %% [markdown]
# ## For other programs
#
# The results file opens in silx, h5web and MATLAB as it is (`docs/results-file.md`). For ParaView, spreadsheets and
# MultiDIC:
#
# ```
# bscd export tutorial-data/results.h5 --to vtk tutorial-data/paraview
# ```

# %%
from bscd.results.export import export_vtk

if not (folder / "paraview").exists():
    made = export_vtk(membrane.results, folder / "paraview")
    print("open", made[-1], "in ParaView")
membrane.close()
