"""From a data set to compared estimates: the order of work, and the run folder it leaves behind."""
