"""What a plant asks its history, each with its statement: for the documentation, and for tests."""

from ledger.scene import Value


class Question(Value, frozen=True, kw_only=True):
    """A question, what its answer shows, and how it is asked."""

    title: str
    doc: str
    sql: str


def _ask(title: str, doc: str, sql: str) -> Question:
    return Question(title=title, doc=doc, sql=sql.strip())


QUESTIONS: tuple[Question, ...] = (
    _ask(
        "How many orders are done in each hour?",
        "Throughput by hour of the end, without the robots' own needs.",
        """
SELECT date_trunc('hour', done_on) AS hour, count(*) AS done
FROM orders
WHERE status = 'Done' AND kind = 'Business'
GROUP BY hour
ORDER BY hour
""",
    ),
    _ask(
        "For what do orders wait, and how long?",
        "Waiting time by reason: before an order has a robot (Assignment) and after (Execution). "
        "No code = dispatch had not said yet.",
        """
SELECT phase, code, count(*) AS waits, count(DISTINCT order_id) AS orders,
       sum(seconds) AS total_s, avg(seconds) AS average_s
FROM waits
GROUP BY phase, code
ORDER BY total_s DESC, phase, code
""",
    ),
    _ask(
        "How busy is each robot?",
        "Utilisation: the share of all its time, and of the time in which it could have worked, "
        "that a robot had a business order.",
        """
SELECT scene_id, robot,
       sum(seconds) FILTER (state = 'Busy') / nullif(sum(seconds), 0) AS of_all,
       sum(seconds) FILTER (state = 'Busy')
         / nullif(sum(seconds) FILTER (state NOT IN ('Disabled', 'Offline')), 0) AS of_able
FROM robot_states
GROUP BY scene_id, robot
ORDER BY scene_id, robot
""",
    ),
    _ask(
        "How much of the driving is empty?",
        "The ledger knows no metres: what stands for empty travel is the time from the assignment "
        "to the end of the first pick-up, and for all travel the time to the order's end.",
        """
WITH first_loads AS (
    SELECT order_id, min(ended_on) AS loaded_on
    FROM steps
    WHERE for_load AND ended_on IS NOT NULL
    GROUP BY order_id
)
SELECT actual_robot_name AS robot, count(*) AS orders,
       sum(epoch(loaded_on - robot_allocated_on))
         / nullif(sum(epoch(done_on - robot_allocated_on)), 0) AS empty_share
FROM orders JOIN first_loads ON order_id = id
WHERE status = 'Done' AND loaded_on >= robot_allocated_on
GROUP BY robot
ORDER BY robot
""",
    ),
    _ask(
        "How long does a robot work between two faults?",
        "Mean time between faults: hours in service over the faults that it or its order had.",
        """
WITH service AS (
    SELECT scene_id, robot, sum(seconds) FILTER (online AND NOT disabled) / 3600 AS hours
    FROM robot_states
    GROUP BY scene_id, robot
), broken AS (
    SELECT scene_id, robot, count(*) AS faults
    FROM faults
    WHERE robot IS NOT NULL
    GROUP BY scene_id, robot
)
SELECT scene_id, robot, hours, coalesce(faults, 0) AS faults, hours / faults AS hours_between
FROM service LEFT JOIN broken USING (scene_id, robot)
ORDER BY hours_between NULLS LAST, scene_id, robot
""",
    ),
    _ask(
        "How long does it take to mend what has failed?",
        "Mean time to repair, of faults that have ended, by what had failed and why.",
        """
SELECT "of", reason, count(*) AS faults, avg(seconds) AS mean_s, max(seconds) AS longest_s
FROM faults
WHERE ended_on IS NOT NULL
GROUP BY "of", reason
ORDER BY faults DESC, "of", reason
""",
    ),
    _ask(
        "How long do orders take, by kind?",
        "Lead time from creation to the end: median, and what one of ten, and of a hundred, "
        "exceeds.",
        """
SELECT kind, count(*) AS orders,
       quantile_cont(processing_time, 0.5) AS p50_s,
       quantile_cont(processing_time, 0.9) AS p90_s,
       quantile_cont(processing_time, 0.99) AS p99_s
FROM orders
WHERE status = 'Done'
GROUP BY kind
ORDER BY kind
""",
    ),
    _ask(
        "Which orders were late?",
        "Orders carry no due time, so late means: more than twice the median of all orders "
        "between the same two places.",
        """
SELECT id, load_point, unload_point, processing_time AS took_s,
       median(processing_time) OVER (PARTITION BY load_point, unload_point) AS usual_s
FROM orders
WHERE status = 'Done' AND load_point IS NOT NULL AND unload_point IS NOT NULL
QUALIFY took_s > 2 * usual_s
ORDER BY took_s DESC, id
LIMIT 100
""",
    ),
    _ask(
        "Between which places is most carried?",
        "Orders by pair of stations, those not yet done among them.",
        """
SELECT load_point, unload_point, count(*) AS orders,
       count(*) FILTER (status = 'Done') AS done
FROM orders
WHERE load_point IS NOT NULL AND unload_point IS NOT NULL
GROUP BY load_point, unload_point
ORDER BY orders DESC, load_point, unload_point
LIMIT 50
""",
    ),
    _ask(
        "Which bins and points are the busiest?",
        "Steps done at each place, and how many of them picked up and put down.",
        """
SELECT location, count(*) AS steps,
       count(*) FILTER (for_load) AS loads, count(*) FILTER (for_unload) AS unloads
FROM steps
WHERE status = 'Done'
GROUP BY location
ORDER BY steps DESC, location
LIMIT 50
""",
    ),
    _ask(
        "How long was the queue?",
        "Orders that waited for a robot at each full minute; a minute without a change has no row.",
        """
WITH changes AS (
    SELECT began_on AS at_on, 1 AS change FROM waits WHERE phase = 'Assignment'
    UNION ALL
    SELECT ended_on, -1 FROM waits WHERE phase = 'Assignment' AND ended_on IS NOT NULL
)
SELECT date_trunc('minute', at_on + INTERVAL 59999 MILLISECONDS) AS minute,
       sum(sum(change)) OVER (ORDER BY minute) AS waiting
FROM changes
GROUP BY minute
ORDER BY minute
""",
    ),
    _ask(
        "Who cancels orders?",
        "Cancelled orders by who asked, and how many of them had a robot already.",
        """
SELECT e.by, count(*) AS cancelled, count(*) FILTER (o.actual_robot_name IS NOT NULL) AS on_the_way
FROM events AS e JOIN orders AS o ON o.id = e.order_id
WHERE e.type = 'OrderCancelled'
GROUP BY e.by
ORDER BY cancelled DESC, e.by
""",
    ),
    _ask(
        "Which orders were taken from their robot, and why?",
        "Reassignments by robot and reason.",
        """
SELECT robot, body ->> 'reason' AS reason, count(*) AS withdrawn,
       count(DISTINCT order_id) AS orders
FROM events
WHERE type = 'OrderWithdrawn'
GROUP BY robot, reason
ORDER BY withdrawn DESC, robot, reason
""",
    ),
    _ask(
        "Which robots are passed over most, and why?",
        "How often a robot was considered and could not take the order, by its own reason.",
        """
SELECT robot, reason, count(*) AS passed_over, count(DISTINCT order_id) AS orders
FROM allocations
WHERE NOT chosen AND reason IS NOT NULL
GROUP BY robot, reason
ORDER BY passed_over DESC, robot, reason
""",
    ),
    _ask(
        "How long do robots charge and park?",
        "Seconds with a charging order, a parking order, and with nothing to do.",
        """
SELECT scene_id, robot,
       coalesce(sum(seconds) FILTER (state = 'Charging'), 0) AS charging_s,
       coalesce(sum(seconds) FILTER (state = 'Parking'), 0) AS parking_s,
       coalesce(sum(seconds) FILTER (state = 'Idle'), 0) AS idle_s
FROM robot_states
GROUP BY scene_id, robot
ORDER BY scene_id, robot
""",
    ),
    _ask(
        "How long were robots not to be reached?",
        "Outages by robot: how many, how long in all, the longest, and whether one lasts.",
        """
SELECT scene_id, robot, count(*) AS outages, sum(seconds) AS offline_s,
       max(seconds) AS longest_s, bool_or(ended_on IS NULL) AS lasts
FROM faults
WHERE "of" = 'Robot'
GROUP BY scene_id, robot
ORDER BY offline_s DESC, scene_id, robot
""",
    ),
    _ask(
        "Who tells the server what?",
        "Callers by how many commands had an effect, and which one most often.",
        """
SELECT "by", count(DISTINCT command) AS commands, count(*) AS events, mode(type) AS mostly
FROM events
WHERE "by" <> ''
GROUP BY "by"
ORDER BY commands DESC, "by"
LIMIT 20
""",
    ),
    _ask(
        "Which orders were touched after they had been made?",
        "Steps added, changed or deleted, other priorities, holds: by order.",
        """
SELECT order_id, count(*) AS changes, list(DISTINCT type ORDER BY type) AS what
FROM events
WHERE type IN ('StepsAdded', 'StepsChanged', 'StepsDeleted', 'OrderPrioritised',
               'OrderSuspended', 'OrderUnsuspended')
GROUP BY order_id
ORDER BY changes DESC, order_id
LIMIT 100
""",
    ),
    _ask(
        "How long do steps take?",
        "From setting out to done, by place and by what is done there.",
        """
SELECT location, CASE WHEN for_load THEN 'Load' WHEN for_unload THEN 'Unload' ELSE 'Other' END
         AS does,
       count(*) AS steps, avg(epoch(ended_on - started_on)) AS average_s,
       quantile_cont(epoch(ended_on - started_on), 0.95) AS p95_s
FROM steps
WHERE status = 'Done' AND started_on IS NOT NULL
GROUP BY location, does
ORDER BY steps DESC, location, does
LIMIT 100
""",
    ),
    _ask(
        "At what time of the day does the load come?",
        "Orders made in each hour of the day (UTC), on an average day.",
        """
SELECT extract('hour' FROM created_on) AS hour_of_day, count(*) AS orders,
       count(*) / (SELECT count(DISTINCT created_on::DATE) FROM orders) AS a_day
FROM orders
WHERE kind = 'Business'
GROUP BY hour_of_day
ORDER BY hour_of_day
""",
    ),
    _ask(
        "What happened in the minute before a fault?",
        "Types of events of the same robot or order before the faults of each reason: what comes "
        "often is worth a look.",
        """
WITH looked_at AS (
    SELECT *, unnest([date_trunc('minute', began_on),
                      date_trunc('minute', began_on) - INTERVAL 1 MINUTE]) AS minute
    FROM faults
)
SELECT f."of", f.reason, e.type, count(*) AS times, count(DISTINCT f.position) AS before_faults
FROM looked_at AS f JOIN events AS e
     ON date_trunc('minute', e.at_on) = f.minute AND e.scene = f.scene_id
     AND e.at_on > f.began_on - INTERVAL 1 MINUTE AND e.position < f.position
     AND (e.robot = f.robot OR e.order_id = f.order_id)
GROUP BY f."of", f.reason, e.type
ORDER BY times DESC, f."of", f.reason, e.type
LIMIT 100
""",
    ),
    _ask(
        "Who reserved ground, and for how long?",
        "Reservations from outside by owner: asked for, held, never had, and the time held.",
        """
SELECT owner, count(*) AS asked, count(granted_on) AS held,
       count(*) FILTER (lapsed) AS never_had, coalesce(sum(held_s), 0) AS held_s
FROM reservations
GROUP BY owner
ORDER BY held_s DESC, owner
""",
    ),
    _ask(
        "Which robots made which others wait, and for how long?",
        "Time that robots waited in traffic for one another on the last day, by pair; who waits "
        "for several at once is counted for each of them. Other days: change the first condition.",
        """
SELECT w.robot, blocker, sum(times) AS times, sum(seconds) AS waited_s,
       max(longest_s) AS longest_s, mode(reason) AS mostly
FROM robot_waits AS w, unnest(blockers) AS u(blocker)
WHERE until_on > (SELECT max(at_on) FROM events) - INTERVAL 1 DAY
GROUP BY w.robot, blocker
ORDER BY waited_s DESC, w.robot, blocker
LIMIT 100
""",
    ),
    _ask(
        "Which place causes most waiting?",
        "Time that robots waited to get to each point, why, and how many of them.",
        """
SELECT place, sum(seconds) AS waited_s, sum(times) AS times,
       count(DISTINCT robot) AS robots, max(longest_s) AS longest_s, mode(reason) AS mostly
FROM robot_waits
WHERE place IS NOT NULL
GROUP BY place
ORDER BY waited_s DESC, place
LIMIT 50
""",
    ),
    _ask(
        "When did robots wait for each other?",
        "Cycles of three seconds and more by the robots in them: how often, and how long.",
        """
SELECT robots, count(DISTINCT from_on) AS times, min(from_on) AS first_on,
       max(epoch(until_on - from_on)) AS longest_s
FROM wait_cycles
GROUP BY robots
ORDER BY times DESC, robots
""",
    ),
    _ask(
        "How often does traffic plan, and push robots out of the way?",
        "By day: plannings by what made them due, and robots that made way for others.",
        """
WITH noted AS (
    SELECT date_trunc('day', at_on) AS day, body::JSON AS body
    FROM events
    WHERE type = 'RobotsWaited'
), counted AS (
    SELECT day, 'Pushes' AS what, (body ->> 'pushes')::BIGINT AS n FROM noted
    UNION ALL
    SELECT day, key, (body -> 'plannings' ->> key)::BIGINT
    FROM (SELECT day, body, unnest(json_keys(body, '$.plannings')) AS key FROM noted)
)
SELECT day, what, sum(n)::BIGINT AS times
FROM counted
GROUP BY day, what
ORDER BY day, what
""",
    ),
)
