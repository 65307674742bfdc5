"""The tables of a record, the same in SQLite and PostgreSQL. Rows are added, never changed or removed, but for tallies,
which count them, and for the lease of the scheduler.

A chunk counts unless it is voided: a chunk of a worker that was found wrong is voided, and run again in the job's next
epoch. Of iterations the last row counts. States only spare a replay: what they say follows from the chunks, and
one that does not match them is replaced.
"""

import sqlalchemy as sa

from service.evaluation.store.columns import keys

VERSION = "0012"  # the newest of migrations/versions

metadata = sa.MetaData()

CHUNK_KEY = {
    "job": sa.Text,
    "phase": sa.Text,
    "iteration": sa.Integer,
    "start": sa.Integer,
    "epoch": sa.Integer,
}

chunks = sa.Table(
    "chunks",
    metadata,
    *keys(**CHUNK_KEY),
    sa.Column("stop", sa.Integer, nullable=False),
    sa.Column("f", sa.LargeBinary, nullable=False),  # float64 little-endian, NaN = failed
    sa.Column("outcomes", sa.LargeBinary, nullable=False),  # uint8: service.evaluation.pool.OUTCOME_CODES
    sa.Column("steps", sa.LargeBinary, nullable=False),  # int32 little-endian
    sa.Column("errors", sa.Text, nullable=False),  # JSON: {"row": "reason"}, rows counted from `start`
    sa.Column("worker_s", sa.Float, nullable=False),  # what it took a worker
    sa.Column("digest", sa.Text, nullable=False),  # of the rows' x and noise seeds, "" = not known
    sa.Column("worker", sa.Text, nullable=False),  # "" = a local process
    sa.Column("checksum", sa.Text, nullable=False, server_default=""),  # of all the row says, "" = an old row
    sa.Column("in_sumo", sa.Integer),  # how many of the rollouts SUMO has driven; NULL = an old row
    sa.Column("contacts", sa.Text),  # JSON: {"row": contact}, rows counted from `start`; NULL = an old row
    sa.Index("chunks_by_worker", "worker"),
)

voids = sa.Table(
    "voids",
    metadata,
    *keys(**CHUNK_KEY),
    sa.Column("next_epoch", sa.Integer, nullable=False),  # in which the rows are run again
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("at", sa.Text, nullable=False),  # ISO 8601, UTC; so are all
)

audits = sa.Table(
    "audits",
    metadata,
    *keys(**CHUNK_KEY, worker=sa.Text),  # worker: who ran the rows again, to the same bits
    sa.Column("at", sa.Text, nullable=False),
)

jobs = sa.Table(
    "jobs",
    metadata,
    *keys(id=sa.Text),
    sa.Column("number", sa.Integer, nullable=False, unique=True),  # order of submission
    sa.Column("spec", sa.Text, nullable=False),  # service.evaluation.job.Job as JSON
    sa.Column("priority", sa.Integer, nullable=False),
    sa.Column("weight", sa.Float, nullable=False),
    sa.Column("label", sa.Text, nullable=False),
    sa.Column("max_failed", sa.Float, nullable=False, server_default="1"),  # share that is tolerated
    sa.Column("at", sa.Text, nullable=False),
)

events = sa.Table(
    "events",
    metadata,
    *keys(job=sa.Text, number=sa.Integer),
    sa.Column("kind", sa.Text, nullable=False),  # "status" and what else a job tells
    sa.Column("body", sa.Text, nullable=False),  # JSON
    sa.Column("at", sa.Text, nullable=False),
    sa.Index("events_by_kind", "job", "kind", "number"),
)

iterations = sa.Table(
    "iterations",
    metadata,
    *keys(job=sa.Text, epoch=sa.Integer, number=sa.Integer),
    sa.Column("record", sa.Text, nullable=False),  # ce.TrainingRecord or ce.EstimationRecord as JSON
    sa.Column("at", sa.Text, nullable=False),
    sa.Column("checksum", sa.Text, nullable=False, server_default=""),  # of all the row says, "" = an old row
)

quarantine = sa.Table(
    "quarantine",
    metadata,
    *keys(worker=sa.Text),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("at", sa.Text, nullable=False),
)

states = sa.Table(
    "states",
    metadata,
    # tailroad: digest of the software that wrote it: another one may come to another state
    *keys(job=sa.Text, epoch=sa.Integer, tailroad=sa.Text),
    sa.Column("number", sa.Integer, nullable=False),  # of batches taken in
    # of the algorithm after them, as its to_bytes writes it
    sa.Column("state", sa.LargeBinary, nullable=False),
    sa.Column("at", sa.Text, nullable=False),
    sa.Column("record", sa.Text, nullable=False, server_default=""),  # digest of the chunks it follows from
    sa.Column("checksum", sa.Text, nullable=False, server_default=""),  # of all the row says
)

beginnings = sa.Table(
    "beginnings",
    metadata,
    *keys(job=sa.Text),
    sa.Column("spec", sa.Text, nullable=False),  # service.evaluation.job.Job as JSON, as it was asked for
    sa.Column("software", sa.Text, nullable=False),  # service.evaluation.software.Software as JSON
    sa.Column("at", sa.Text, nullable=False),
    sa.Column("checksum", sa.Text, nullable=False),  # of all the row says
)

tallies = sa.Table(
    "tallies",
    metadata,
    *keys(job=sa.Text),
    sa.Column("chunks", sa.Integer, nullable=False),  # of the job that were ever recorded
)

artefacts = sa.Table(
    "artefacts",
    metadata,
    *keys(job=sa.Text, name=sa.Text),
    sa.Column("data", sa.LargeBinary, nullable=False),
    sa.Column("checksum", sa.Text, nullable=False),  # of job, name and data
)

leases = sa.Table(
    "leases",
    metadata,
    *keys(name=sa.Text),  # of what is held: "scheduler"
    sa.Column("epoch", sa.Integer, nullable=False),  # one more with each claim: an earlier one writes no more
    sa.Column("holder", sa.Text, nullable=False),  # host and process, for people
    sa.Column("since", sa.Float, nullable=False),  # s, of the database's clock; so is the next
    sa.Column("until", sa.Float, nullable=False),  # renewed while the holder lives
)

audit_log = sa.Table(
    "audit_log",
    metadata,
    *keys(number=sa.Integer),
    sa.Column("at", sa.Text, nullable=False),
    sa.Column("who", sa.Text, nullable=False),  # by the connection
    sa.Column("did", sa.Text, nullable=False),
    sa.Column("job", sa.Text, nullable=False),
    sa.Column("refused", sa.Text, nullable=False),  # why it was not done, "" where it was
    sa.Column("hash", sa.Text, nullable=False),  # of the row and, by the one before it, of all before
)

# by dialect: rows of the log are neither changed nor removed by mistake
APPEND_ONLY = {
    "sqlite": tuple(
        f"CREATE TRIGGER audit_log_no_{deed.lower()} BEFORE {deed} ON audit_log "
        "BEGIN SELECT RAISE(ABORT, 'rows are only added to the audit log'); END"
        for deed in ("UPDATE", "DELETE")
    ),
    "postgresql": (
        "CREATE FUNCTION audit_log_only_grows() RETURNS trigger LANGUAGE plpgsql AS "
        "$$ BEGIN RAISE EXCEPTION 'rows are only added to the audit log'; END $$",
        "CREATE TRIGGER audit_log_only_grows BEFORE UPDATE OR DELETE OR TRUNCATE ON audit_log "
        "FOR EACH STATEMENT EXECUTE FUNCTION audit_log_only_grows()",
    ),
}
for _dialect, _statements in APPEND_ONLY.items():
    for _statement in _statements:
        sa.event.listen(audit_log, "after_create", sa.DDL(_statement).execute_if(dialect=_dialect))
