"""What a run says: failure modes, what the search learned, comparisons, risk, traces, films and reports."""
