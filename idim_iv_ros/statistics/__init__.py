"""May the estimates be believed: instruments, exogeneity, residuals and the verdict.

- `hypothesis`: the result of a test, and `f_test`, through which all F-tests here go
- `instruments`: `wald_test_of_instruments`, H0 Π = I (revised Durbin-Wu-Hausman), and
  `exogeneity_test`, H0 γ = 0 in the augmented regression (Durbin-Wu-Hausman)
- `specification`: `specification_tests`, H0 nothing of the motion in the residual (RESET)
- `residuals`: `ljung_box`, Jarque-Bera, autocorrelation of one joint; how far its RMS scatters
- `gls`: regression with autoregressive errors, by which the first three whiten
- `verdict`: what they say together, joint by joint
"""

from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.instruments import exogeneity_test, wald_test_of_instruments
from idim_iv_ros.statistics.residuals import ResidualDiagnosis, diagnose_residual
from idim_iv_ros.statistics.specification import specification_tests
from idim_iv_ros.statistics.verdict import OverallVerdict, judge_all, judge_joint

__all__ = [
    "HypothesisTest",
    "OverallVerdict",
    "ResidualDiagnosis",
    "diagnose_residual",
    "exogeneity_test",
    "judge_all",
    "judge_joint",
    "specification_tests",
    "wald_test_of_instruments",
]
