"""What other commands wrote, read back: recognised by what it holds, every row with its place."""
