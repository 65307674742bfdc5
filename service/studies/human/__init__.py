"""How often drivers who err as people do come to grief, beside what people do; and the fit of their noise."""
