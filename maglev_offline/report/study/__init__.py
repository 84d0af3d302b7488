"""The part of the report on a study of many arms: what each did, run by run, and why."""
