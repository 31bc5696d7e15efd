"""Pages: `verify` (is the model solved right), `validate` (does it fire like skin), `report`."""
