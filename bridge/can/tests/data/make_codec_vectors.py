"""Writes codec_vectors.csv: frames that cantools (PyPI) encodes from codec.dbc.

    python3 make_codec_vectors.py
"""

import csv
import pathlib
import random

import cantools

here = pathlib.Path(__file__).parent
database = cantools.database.load_file(here / "codec.dbc")
random.seed(1)
with open(here / "codec_vectors.csv", "w", newline="") as file:
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(["message", "signals", "values", "frame_id", "extended", "data"])
    for message in database.messages:
        pages = [0, 5] if message.is_multiplexed() else [None]
        for page in pages:
            for _ in range(60):
                values = {}
                for signal in message.signals:
                    if signal.is_multiplexer:
                        values[signal.name] = page
                    elif signal.multiplexer_ids and page not in signal.multiplexer_ids:
                        continue
                    elif signal.minimum is None or signal.is_float:
                        values[signal.name] = random.uniform(-1e6, 1e6)
                    else:
                        steps = 2**signal.length - 1
                        low, high = (
                            (-(steps // 2), steps // 2) if signal.is_signed else (0, steps)
                        )
                        while True:
                            value = signal.scale * random.randint(low, high) + signal.offset
                            if signal.minimum <= value <= signal.maximum:
                                break
                        values[signal.name] = value
                data = message.encode(values)
                rows.writerow(
                    [
                        message.name,
                        " ".join(values),
                        " ".join(repr(float(value)) for value in values.values()),
                        message.frame_id,
                        int(message.is_extended_frame),
                        data.hex(),
                    ]
                )
