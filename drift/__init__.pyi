"""Types of the public names: what __init__.py finds at their first use."""

from drift.arrays.planner import place as place
from drift.arrays.processing_plan import allocate as allocate
from drift.case.file import load as load
from drift.case.file import vary as vary
from drift.case.record import Case as Case
from drift.cli.progress import progress as progress
from drift.contrast.contrast import compare as compare
from drift.desk.server import serve as serve
from drift.drifters.fitting import fit_errors as fit_errors
from drift.drifters.verification import verify as verify
from drift.exchange.exporter import export as export
from drift.flow import origin as origin
from drift.flow import run as run
from drift.flow import trace as trace
from drift.many import Brief as Brief
from drift.many import run_many as run_many
from drift.output.publication import results as results
from drift.patrols.patrol import patrol as patrol
from drift.planner.planner import plan as plan
from drift.preview.check import check as check
from drift.providers.fetching import fetch as fetch
from drift.reach.command import sensor_reach as sensor_reach
from drift.result import Result as Result
from drift.version import __version__ as __version__
from geo.errors import UserError as UserError
