"""Campaigns of simulated recordings: a table of factors times seeds.

They run on processes of this machine or a Dask cluster, are kept as Parquet and have a report.
"""
