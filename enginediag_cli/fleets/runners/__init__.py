"""Where the work of a fleet is done: in this process, in several, or on a Dask cluster."""
