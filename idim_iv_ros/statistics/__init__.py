"""May the estimates be believed: instruments, exogeneity, residuals and the verdict."""

from idim_iv_ros.statistics.exogeneity import exogeneity_test
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.instruments import wald_test_of_instruments
from idim_iv_ros.statistics.residuals import ResidualDiagnosis, diagnose_residual
from idim_iv_ros.statistics.specification import specification_tests
from idim_iv_ros.statistics.verdict import JointVerdict, OverallVerdict, judge_all, judge_joint

__all__ = [
    "HypothesisTest",
    "JointVerdict",
    "OverallVerdict",
    "ResidualDiagnosis",
    "diagnose_residual",
    "exogeneity_test",
    "judge_all",
    "judge_joint",
    "specification_tests",
    "wald_test_of_instruments",
]
