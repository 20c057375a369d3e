"""Every table and figure of four papers as a command with a verdict: `slam-gym reproduce`.

One module per table or figure holds an `Experiment`; `catalogue` lists them. An experiment measures through
`slam_gym.evaluation.compare` (`study`), puts the paper's claims against intervals (`verdict`) and draws in the paper's
layout. `runner` keeps what each found, `page` and `markdown` show it; `results.json` is what the last full run gave,
from which REPRODUCTION.md is generated.
"""
