"""The verbs of the command line, one module each: glue, no logic of their own."""
