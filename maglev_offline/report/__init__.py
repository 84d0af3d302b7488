"""The report: one page that shows every artefact of a workspace, in figures, tables and plain sentences."""
