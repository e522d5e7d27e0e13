"""What restoring a module would bring, and what maintenance did bring: temperature and fuel at equal power."""
