"""Laws for what no library holds: place × formula in dimensionless variables."""
