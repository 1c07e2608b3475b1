"""One script a figure of the paper: numbers first, then claims about the numbers, then a drawing of the same numbers.

`run(out, seed=0)` of each gives its claims and writes its picture; `python experiments/figure_3.py` prints them.
"""
