"""IDIM-LS, IDIM-IV and refined IDIM-IV, with the covariance of their estimates."""
