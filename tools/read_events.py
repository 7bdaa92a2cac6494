"""Prints the scalars of a TensorBoard event file or folder as JSON, read by TensorBoard's own package: {tag: [[step, value]]}.

Usage: .venv/bin/python tools/read_events.py runs/NAME
"""

import json
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    events = EventAccumulator(sys.argv[1], size_guidance={"scalars": 0, "tensors": 0})
    events.Reload()
    tags = events.Tags()["scalars"]
    print(json.dumps({tag: [[event.step, event.value] for event in events.Scalars(tag)] for tag in tags}))


if __name__ == "__main__":
    main()
