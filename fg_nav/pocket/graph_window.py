"""The end of the pocket's graph: the nodes of the last seconds, solved anew whenever there are new ones.

What is older is left with what it says of the first node of the window, as it was linearised and weighed then. That is
the same elimination as of all of the graph, from the first node on: an estimate at the end has all the past in it, and
but for weights that only the future could have told it is that of the batch solution of what there was.
"""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.pocket.graph_chain import SIZE, Nodes, Solved
from fg_nav.pocket.graph_field import walk_of_strength
from fg_nav.pocket.graph_links import Links
from fg_nav.pocket.graph_motion import REST_LINKS, rests_of
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.graph_solution import (
    Prior,
    Weighed,
    beliefs_of,
    factors_of,
    moved,
    predicted,
    prior_of,
    reweighed,
    solve_round,
    unweighed,
)
from fg_nav.pocket.start import PocketStart


class Window:
    """Nodes of the last `lag_s`, and what older ones say of the first of them.

    Attributes
    ----------
    nodes, solved, weighed : of the last round; the weights are those for the next one.
    """

    nodes: Nodes
    solved: Solved
    weighed: Weighed

    def __init__(self, prior: Prior, links: Links, parameters: PocketGraphParameters) -> None:
        self._p = parameters
        self._beliefs = beliefs_of(parameters, links.bias)
        self._prior = prior
        self._links, self._past = links, 0
        self.nodes = predicted(self._prior, links, self._beliefs)
        self._linearised = self.nodes
        self.weighed = unweighed(self._walk(), links, parameters)
        self._solve()

    @property
    def last(self) -> Prior:
        """What is known of the last node."""
        return _known(self.nodes, -1, self.solved.P[-1])

    def extend(self, new: Links) -> int:
        """Add links and solve; returns how many of the nodes there were have left the window."""
        self._links = self._links.then(new)
        more = predicted(_known(self.nodes, -1), new, self._beliefs)
        self.nodes = Nodes(*(np.concatenate([x, y[1:]]) for x, y in zip(self.nodes, more, strict=True)))
        left = self._leave()
        self.weighed = self._with_new(self.weighed, left)
        self._solve()
        return left

    def _walk(self) -> Floats:
        return walk_of_strength(self._links, self._p)[self._past :]

    def _solve(self) -> None:
        p, walk = self._p, self._walk()
        links = self._links.part(self._past, len(self._links))
        rests = rests_of(self._links, p).after(self._past)
        for _ in range(p.rounds):
            self._linearised = self.nodes
            factors = factors_of(links, p, self.weighed, rests)
            self.nodes, self.solved = solve_round(self._prior, self.nodes, links, self._beliefs, factors)
            self.weighed = reweighed(walk, links, self.solved, p)

    def _with_new(self, old: Weighed, left: int) -> Weighed:
        """Weights of the last round for what was there, none for what is new; the last node begins no link before."""
        links = self._links.part(self._past, len(self._links))
        blank = unweighed(self._walk(), links, self._p)
        kept = len(old.step) - left
        return Weighed(
            np.concatenate([old.step[left:], blank.step[kept:]]),
            np.concatenate([old.deviation[left:-1], blank.deviation[kept:]]),
            np.concatenate([old.pace[left:], blank.pace[kept:]]),
            np.concatenate([old.swing[left:], blank.swing[kept + 1 :]]),
        )

    def _leave(self) -> int:
        """Leave nodes older than the lag, but keep the links that rests and the spread of strength still reach."""
        p, links = self._p, self._links
        oldest = links.start_s[-1] + links.h[-1] - p.lag_s
        left = int(np.searchsorted(links.start_s[self._past :], oldest - 1e-6))
        left = min(left, len(self.solved.x_ahead) - 1)
        if left:
            ahead = moved(Nodes(*(part[: left + 1] for part in self._linearised)), self.solved.x_ahead[: left + 1])
            self._prior = _known(ahead, left, self.solved.P_ahead[left])
            self.nodes = Nodes(*(part[left:] for part in self.nodes))
        self._past += left
        reach = int(np.ceil(p.field_window_s / p.node_s)) + REST_LINKS
        useless = max(self._past - reach, 0)
        self._links = links.part(useless, len(links))
        self._past -= useless
        return left


def _known(nodes: Nodes, k: int, P: Floats = np.zeros((SIZE, SIZE))) -> Prior:
    return Prior(nodes.R[k], nodes.y[k], P)


def from_the_past(links: Links, start: PocketStart, p: PocketGraphParameters) -> tuple[Nodes, Weighed]:
    """Nodes and weights of all links as they were when they left the window, the last ones as they are at the end."""
    every = max(round(p.lag_s / 2 / p.node_s), 1)
    window = Window(prior_of(start, links, p), links.part(0, every), p)
    nodes: list[Nodes] = []
    weights: list[Weighed] = []
    for first in range(every, len(links), every):
        old_nodes, old_weights = window.nodes, window.weighed
        left = window.extend(links.part(first, min(first + every, len(links))))
        nodes.append(Nodes(*(x[:left] for x in old_nodes)))
        weights.append(Weighed(*(x[:left] for x in old_weights)))
    nodes.append(window.nodes)
    weights.append(window.weighed)
    return (
        Nodes(*(np.concatenate(x) for x in zip(*nodes, strict=True))),
        Weighed(*(np.concatenate(x) for x in zip(*weights, strict=True))),
    )
