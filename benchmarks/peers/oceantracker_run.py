"""OceanTracker's part of benchmarks/peers.py: the current only, by its RK4, on triangles."""

import json
import sys
import time
from importlib import metadata
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from oceantracker.main import OceanTracker
from oceantracker.plot_output import plot_tracks
from oceantracker.read_output.python import load_output_files


def main() -> None:
    """Run, draw, and print what came out as JSON."""
    job = json.loads(sys.argv[1])
    folder, n = Path(job["folder"]), job["particles"]
    lon, lat = np.load(folder / "starts.npy")[:, :n]
    tracker = OceanTracker()
    tracker.settings(
        output_file_base="run",
        root_output_dir=job["out"],
        time_step=job["step"],
        use_dispersion=False,
        NUMBA_cache_code=True,
        screen_output_time_interval=86_400,
    )
    tracker.add_class(
        "reader", input_dir=str(folder), file_mask="triangles.nc", class_name="SCHISMreader"
    )
    tracker.add_class(
        "release_groups",
        name="all",
        class_name="PointRelease",
        points=np.column_stack([lon, lat]),
        pulse_size=1,
        release_interval=0,
        start=job["start"],
        max_age=job["hours"] * 3600 + 1,
    )
    tracker.add_class("tracks_writer", update_interval=job["every"])
    tracker.settings(max_run_duration=job["hours"] * 3600)
    begun = time.perf_counter()
    case = tracker.run()
    ran = time.perf_counter() - begun
    tracks = load_output_files.load_track_data(case)
    if job["picture"]:
        plot_tracks.plot_tracks(tracks, plot_file_name=job["picture"])
    end = tracks["x"][-1]
    print(
        json.dumps(
            {
                "version": metadata.version("oceantracker"),
                "run_s": ran,
                "particles": int(np.isfinite(end[:, 0]).sum()),
                "lon": float(np.nanmean(end[:, 0], dtype=float)),
                "lat": float(np.nanmean(end[:, 1], dtype=float)),
            }
        )
    )


if __name__ == "__main__":
    main()
