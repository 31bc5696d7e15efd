"""CalculiX: the dialect of ccx 2.20. Another solver is a folder like this one."""
