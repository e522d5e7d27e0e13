"""Blind trials of several causes at once."""
