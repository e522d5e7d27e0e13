"""Controls: what holds a quantity, follows a schedule or is recorded, and the limits between which it acts."""
