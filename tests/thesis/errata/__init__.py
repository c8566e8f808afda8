"""One test an erratum: the printed form fails against an independent check, the corrected one passes."""
