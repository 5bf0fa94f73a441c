"""The paper's experiments of Sec. 5 and the comparison of filters: runs, tables and pictures."""

from binopos_ros.evaluation.cells import Table
from binopos_ros.evaluation.errors import EvaluationError
from binopos_ros.evaluation.run import Results, evaluate
from binopos_ros.evaluation.settings import QUICK, Settings
from binopos_ros.evaluation.store import Store
from binopos_ros.evaluation.tables import tables

__all__ = [
    'QUICK',
    'EvaluationError',
    'Results',
    'Settings',
    'Store',
    'Table',
    'evaluate',
    'tables',
]
