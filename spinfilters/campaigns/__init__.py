"""Campaigns of simulated recordings: a table of factors times seeds.

They run on processes, a cluster or shards, are kept as Parquet and told in a report.
"""
