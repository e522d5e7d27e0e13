"""Methods that make residuals of their own: parity, observers, principal components, estimation, the local approach."""
