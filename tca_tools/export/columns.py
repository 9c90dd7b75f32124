"""The columns of the exported tables: a line for each, with its type and its meaning.

Times are seconds on the journal's clock.
"""

COLUMNS = {
    "run": (
        "One row about the run. Parts of other tables without an `end` were unfinished at `until`.",
        """
epoch          the name of the run
began:s        when the journal's clock showed 0, in seconds since 1970
first:s        time of the first entry
last:s         time of the last entry
until:s        time up to which the run is known: now for a live run, else the last entry
live:flag      whether the run still runs
entries:int    number of entries
""",
    ),
    "messages": (
        "Every message that central accepted, tasks included.",
        """
id:int          number of the message; a task has the same number
name            name of the message
class           class of the message
sender          the sending module, or "central"
origin:int      the delivery whose handler sent it
role            the reason why central made it
about:int       the message that central made it for
sent:s          when it was sent
started:s       when its first handler started
ended:s         when its last handler ended
answered:s      when its sender had the answer; only for queries
handlings:int   number of handlings
failure         the failure raised on it, unless a retry followed
handled:flag    whether the failure left the run to continue, or may still do so
dropped         why it was dropped
data:json       its data
result:json     its reply or result
failure_data:json  the data of the failure with which its last handler ended
""",
    ),
    "tasks": (
        "Every goal, command, exception handler and monitor of the tree.",
        """
id:int              number of the task, as in `messages`
name                name of its message
parent:int          number of its parent; 0 for the root
depth:int           1 for a top-level task, 2 for its subtasks and so on
state               its state at the end
start_handling:s    when its handler first started
end_handling:s      when its handler had returned
start_planning:s    when its planning started
end_planning:s      when it was planned, with all below it
start_achieving:s   when its achievement started
end_achieving:s     when it was achieved, with all below it
killed              why it was killed
killed_by           the module that killed it, or "central"
killed_from:int     the delivery whose handler killed it
killed_for:int      the task whose failure killed it
suspended:flag      whether it is suspended
""",
    ),
    "states": (
        "A row for each state of each task. A held, queued, planned or suspended task waits.",
        """
task:int   number of the task
name       name of its message
state      the state
start:s    when the state began
end:s      when the next state began; nothing for the last state
""",
    ),
    "changes": (
        "What clients and handlers of tasks reported to each other. Other tables have the rest.",
        """
task:int     number of the task
name         name of its message
time:s       when it changed
transition   the transition of its life cycle, such as `update` or `accept`
state        the state after it
serial:int   number among the changes of the task
by           the party that made it: client, server or central
module       the module that made it
text         the reason
data:json    the new goal or the intermediate result; for `accept`, a goal that is not the newest
""",
    ),
    "handlings": (
        "Every run of a handler.",
        """
message:int    number of the message
delivery:int   number of the delivery
name           name of the message
module         the module of the handler
resource       the resource of the handler
start:s        when the handler started
end:s          when it ended
outcome        done or failed; killed if its task had been killed; nothing if it was cut off
handled:flag   for a failed handler: whether the run continued, as in `messages`
slot:int       number of the resource's slot
nested:flag    whether another message waited in that slot
priority:int   priority of the message
""",
    ),
    "failures": (
        "Every failure that was raised, also if a retry followed.",
        """
message:int      number of the failing message
name             name of that message
time:s           when the failure was raised
failure          name of the failure
text             its explanation
raised_by        the module that raised it, or "central"
raised_from:int  the delivery whose handler raised it from outside
fate             what became of it, such as `retried`
handled:flag     whether the run continued, as in `messages`
""",
    ),
    "drops": (
        "Every message that was dropped.",
        """
time:s        when it was dropped
message:int   number of the message
name          name of the message
copy:flag     whether it is one receiver's copy
reason        overload, displaced, given up or deadlock; nothing for another reason
why           the reason in words
""",
    ),
    "queueings": (
        "Every wait in a queue.",
        """
message:int    number of the message
name           name of the message
module         the module of the resource; empty if no module handled the message
resource       the resource; empty if no module handled the message
priority:int   priority of the message
start:s        when the wait began
end:s          when it ended
""",
    ),
    "waits": (
        "All waits of tasks, messages, handlers and programs: a row for each cause.",
        """
message:int    number of the waiting message; nothing for code outside of handlers
module         the module that waits, or whose queue it is
resource       the resource of the handler or queue
delivery:int   the delivery whose handler waits
kind           the kind of wait, see below
on:int         number of the message, task or claim that is waited for
name           name of that message or task
moment         the moment that it must reach
start:s        when the wait began
end:s          when it ended
""",
    ),
    "claims": (
        "Every lock and reservation.",
        """
id:int             number of the claim
module             the module of the resource
resource           the resource
reservation:flag   whether it is a reservation, not a lock
sender             the module that asked for it
origin:int         the delivery whose handler asked for it
asked:s            when it was asked for
granted:s          when it was granted
end:s              when it ended
why                why it ended
""",
    ),
}
"""Table -> its meaning, and its columns."""
