"""The public Python interface, the command line, the pipeline and the report."""
