"""The figures of a run, as Matplotlib figures in one style; none of them needs a display."""
