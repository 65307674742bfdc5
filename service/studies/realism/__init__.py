"""The realism card: how like people the drivers drive, beside other models, on recordings that none has seen.

    tailroad drivers card --weights NAME --data DIR --out DIR

`drive` puts models into recorded scenes, `krauss` does the same with SUMO's own driver, `evaluate` measures all alike,
`card` writes the page and its JSON. What is measured is defined in policies/realism/.
"""
