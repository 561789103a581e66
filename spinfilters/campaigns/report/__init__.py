"""The report of a campaign: statistics of its rows, pictures, one page."""
