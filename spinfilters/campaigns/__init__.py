"""Campaigns: a table of factors times seeds, run on processes, a cluster or shards, kept as Parquet, told in a report."""
