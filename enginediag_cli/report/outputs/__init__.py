"""What each command writes: columns and documents, declared once for whoever makes them and for their schemas."""
