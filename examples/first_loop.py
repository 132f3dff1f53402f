"""A first loop: PD with both observers behind a jittery latency
=============================================================

The mean latency is 80 ms; a steering offset begins after 10 s.

::

    python examples/first_loop.py
"""

from pathlib import Path

from steer_by_wire import Run, simulate


def main(folder: Path = Path("out/examples")) -> Run:
    run = simulate(
        plant="paper_nominal",
        controller="practical_pd_ddob",
        seed=7,
        duration_s=20.0,
        overrides={
            "plant.latency.downlink": {"model": "gamma", "mean_s": 0.08, "spread_s": 0.03},
            "plant.disturbance.steps": [{"at_s": 10.0, "steering_offset_rad": 0.02}],
        },
    )
    print(f"off the path: RMS {1e3 * run.settled_rms_m:.1f} mm")
    print(f"largest command: {abs(run.controller.sent_rad).max():.3f} rad")
    folder.mkdir(parents=True, exist_ok=True)
    run.save(folder / "first_loop")  # settings and tables: enough to repeat the run
    run.plot().savefig(folder / "first_loop.png")
    return run


if __name__ == "__main__":
    main()
