"""The paper's figures and tables made again, as one page that a reviewer can check.

`study.validate` computes, `report.write_report` writes; nothing here needs a solver.
"""
