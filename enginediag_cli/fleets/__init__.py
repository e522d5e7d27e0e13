"""Fleets: recordings of many engines are condensed, kept, put together by serial number, judged and ranked."""
