"""The words of the dashboard, each in a sentence or two; docs/glossary.md says more."""

import re

WORDS = {
    "p": ("The probability that one rollout is dangerous, f ≤ γ, when traffic is drawn from P0."),
    "interval": (
        "Where p lies with the confidence asked for, by the rollouts that were run. An estimate without "
        "it says nothing."
    ),
    "f": (
        "The smallest value of the safety measure over a rollout, as the shortest time to collision: low "
        "is dangerous."
    ),
    "γ": ("The threshold of the event: a rollout is dangerous when f ≤ γ."),
    "P0": ("Standard traffic: the distribution of starts, drivers and weather that a scenario draws from."),
    "X": (
        "All that is random in a rollout and can be searched: starts, drivers' weights and causes, weather."
    ),
    "rollout": (
        "One simulation of a scenario from one draw of X and one seed: the same draw gives the same bits."
    ),
    "proposal": (
        "The distribution that a search draws from in place of P0, so that dangerous rollouts are "
        "frequent. Weights undo the difference."
    ),
    "effective sample size": (
        "How many rollouts of equal weight would know as much as these of unequal weight do."
    ),
    "largest weight": (
        "The part of the estimate that a single rollout carries. Near 100% the estimate is one rollout's."
    ),
    "ending": (
        "How a rollout ended: a collision, off the road, reversing, at the end of the road (finished) or "
        "of its time (horizon)."
    ),
    "failure mode": ("Dangerous rollouts that come about in the same way, as a cut-in from the left."),
    "share of p": ("The part of p that the rollouts of a mode carry, by the weights of the estimate."),
    "log p₀": (
        "How likely a draw is under P0, as a logarithm (nats). Differences matter, not the number itself."
    ),
    "reference driver": (
        "A model of a competent and careful driver, as in UN Regulation 157, put in the ego's place from "
        "the onset of a conflict on."
    ),
    "preventable": ("A dangerous rollout in which the reference driver keeps f above γ."),
    "delta-v": ("The change of a vehicle's velocity in a contact, which the risk of injury depends on."),
}


def anchor(word: str) -> str:
    """Where a word stands on the page."""
    return "word-" + re.sub(r"[^a-z0-9γ₀]+", "-", word.lower())
