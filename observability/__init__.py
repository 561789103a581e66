"""Observability analysis, proved exactly and said in words. See this folder's README."""
