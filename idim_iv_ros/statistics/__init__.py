"""May the estimates be believed: instruments, exogeneity, residuals and the verdict.

- `hypothesis`: the result of a test, and `f_test`, through which all F-tests here go
- `instruments`: `wald_test_of_instruments`, H0 Π = I (revised Durbin-Wu-Hausman), and
  `exogeneity_test`, H0 γ = 0 in the augmented regression (Durbin-Wu-Hausman)
- `specification`: `specification_tests`, H0 nothing of the motion in the residual (RESET)
- `residuals`: `ljung_box`, Jarque-Bera, autocorrelation of one joint; how far its RMS scatters
- `gls`: regression with autoregressive errors, by which the first three whiten
- `verdict`: what they say together, joint by joint
"""
