# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How far a source may run ahead of its consumers."""

from dataclasses import dataclass, field

PROGRESS_LIMIT = 5.0  # [s]


@dataclass
class _Consumer:
    next_index: int
    moved: float


@dataclass
class Credit:
    """
    Progress of all consumers of one stream; not for several threads at once.

    Parameters
    ----------
    stream_id : int
    window : int
        How many samples the source may be ahead of the slowest consumer.
    published : int
        Index of the first sample not yet published. A consumer that joins counts from here.

    """

    stream_id: int
    window: int
    published: int = 0
    _consumers: dict[str, _Consumer] = field(default_factory=dict)
    _forgotten: dict[str, int] = field(default_factory=dict)

    @property
    def progress(self) -> dict[str, int]:
        """First sample not yet consumed, by the name of the consumer."""
        return {name: consumer.next_index for name, consumer in sorted(self._consumers.items())}

    def report(self, name: str, stream_id: int, next_index: int, now: float) -> None:
        """
        Note what a consumer says.

        Parameters
        ----------
        name : str
        stream_id : int
            Words about other streams do not count.
        next_index : int
        now : float
            Time on any steady clock [s].

        """
        if stream_id != self.stream_id or next_index <= self._forgotten.get(name, -1):
            return
        self._forgotten.pop(name, None)
        consumer = self._consumers.get(name)
        if consumer is None:
            self._consumers[name] = _Consumer(max(next_index, self.published), now)
        elif next_index > consumer.next_index:
            self._consumers[name] = _Consumer(next_index, now)

    def allows(self, next_index: int) -> bool:
        """
        Decide whether samples may be published.

        Parameters
        ----------
        next_index : int
            Index of the first sample after them.

        Returns
        -------
        bool

        """
        return all(
            next_index - consumer.next_index <= self.window
            for consumer in self._consumers.values()
        )

    def drop_vanished(self, present: set[str], waiting_since: float, now: float) -> list[str]:
        """
        Forget consumers that are gone or stand still while the source waits for them.

        Parameters
        ----------
        present : set of str
            Nodes that publish their progress.
        waiting_since : float
            Since when the source has been waiting [s].
        now : float
            [s].

        Returns
        -------
        list of str
            Why, a sentence for each that was forgotten.

        """
        reasons = []
        for name, consumer in list(self._consumers.items()):
            behind = self.published - consumer.next_index
            if name not in present:
                reasons.append(f'{name} is gone; it is no longer waited for')
            elif behind and now - max(consumer.moved, waiting_since) > PROGRESS_LIMIT:
                reasons.append(
                    f'{name} is {behind} samples behind and has made no progress for '
                    f'{PROGRESS_LIMIT:g} s; it is no longer waited for'
                )
                self._forgotten[name] = consumer.next_index
            else:
                continue
            del self._consumers[name]
        return reasons
