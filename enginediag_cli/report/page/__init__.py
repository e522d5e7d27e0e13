"""Reports: results of commands as one page that opens offline, can be printed, and be made again byte for byte."""
