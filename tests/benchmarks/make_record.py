"""Rows made by hand."""

from benchmarks.records import CERTIFICATE, Record

# What is a column of its own; other names are figures of the suite or of the certificate.
COLUMNS = set(Record.__dataclass_fields__)


def record(scene="tower-5", case="cold", engine="gpx-lcp", solver="pgs", formulation="coulomb", **more) -> Record:
    """Return a row of the suite stacks; `step_ms` is its time, and every name that is no column a figure."""
    if "step_ms" in more:
        more["step_seconds"] = 1e-3 * more.pop("step_ms")
    known = {"suite": "stacks", "seed": 0, "engine_version": "1", "setting": "x", "effort": 1.0, "tolerance": None}
    known |= {"status": "solved", "where": {}}
    known |= {name: value for name, value in more.items() if name in COLUMNS}
    figures = {name: value for name, value in more.items() if name not in COLUMNS}
    return Record(
        scene=scene,
        case=case,
        engine=engine,
        solver=solver,
        formulation=formulation,
        certificate={name: figures.pop(name) for name in CERTIFICATE if name in figures},
        figures=figures,
        **known,
    )
