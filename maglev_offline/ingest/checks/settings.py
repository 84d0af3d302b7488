"""The `[checks]` table of a recipe; it lies outside this package, so that reading a recipe imports no check."""

from maglev_offline.ingest.check_settings import CheckSettings as CheckSettings
