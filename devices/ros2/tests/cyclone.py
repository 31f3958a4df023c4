"""The other side of the tests: CycloneDDS with ROS 2's names and types, on this computer alone.

Usage: cyclone.py DOMAIN publish|subscribe TOPIC string|joints COUNT
       cyclone.py DOMAIN call SERVICE COUNT
       cyclone.py DOMAIN serve SERVICE

It ends by itself after half a minute, and then with an error.
"""

import json
import os
import sys
import threading
import time

os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain id="any">
<General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""

from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float64, int32, int64, sequence, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

LIMIT = time.monotonic() + 30


@final
@dataclass
class String_(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    data: str


@final
@dataclass
class Time_(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@final
@dataclass
class Header_(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time_
    frame_id: str


@final
@dataclass
class JointState_(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    header: Header_
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


# As rmw_cyclonedds_cpp sends them: a number of the client and one of the call before the fields.
@final
@dataclass
class Request_(IdlStruct, typename="example_interfaces.srv.dds_.AddTwoInts_Request_"):
    guid: uint64
    seq: int64
    a: int64
    b: int64


@final
@dataclass
class Response_(IdlStruct, typename="example_interfaces.srv.dds_.AddTwoInts_Response_"):
    guid: uint64
    seq: int64
    sum: int64


RELIABLE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(100),
)


def say(value):
    print(json.dumps(value), flush=True)


def until(condition, what):
    while not condition():
        if time.monotonic() > LIMIT:
            sys.exit(f"cyclone.py: {what} did not come")
        time.sleep(0.005)


def samples(reader, count):
    """As many as are asked for, as they come."""
    seen = 0
    while seen < count:
        taken = []
        until(lambda: taken.extend(reader.take(1)) or taken, "a value")
        for sample in taken:
            # What is no value tells of a writer that has gone.
            if hasattr(sample, "__dataclass_fields__"):
                seen += 1
                yield sample


def ask(writer, reader, request):
    """The sum. The first request and the first reply may be lost, as at any start: then again."""
    while True:
        writer.write(request)
        again = time.monotonic() + 1
        while time.monotonic() < again:
            for reply in reader.take(1):
                if getattr(reply, "seq", None) == request.seq:
                    assert reply.guid == request.guid, reply
                    return reply.sum
            if time.monotonic() > LIMIT:
                sys.exit("cyclone.py: a reply did not come")
            time.sleep(0.005)


def has_partner(entity):
    if isinstance(entity, DataWriter):
        return entity.get_matched_subscriptions()
    return entity.get_matched_publications()


def begin(*entities):
    """Each side knows its partners by itself: what is sent before both do is lost."""
    until(lambda: all(map(has_partner, entities)), "a partner")
    say("ready")
    sys.stdin.readline()


def value(kind, number):
    if kind == "string":
        return String_(data=f"hello {number}")
    return JointState_(
        header=Header_(stamp=Time_(sec=number, nanosec=500), frame_id="base"),
        name=["shoulder", "elbow"],
        position=[number + 0.25, -1.5],
        velocity=[0.5],
        effort=[],
    )


def main():
    domain, what, name = int(sys.argv[1]), sys.argv[2], sys.argv[3]
    participant = DomainParticipant(domain)
    if what in ("publish", "subscribe"):
        kind, count = sys.argv[4], int(sys.argv[5])
        data_type = {"string": String_, "joints": JointState_}[kind]
        topic = Topic(participant, f"rt/{name}", data_type)
        if what == "publish":
            writer = DataWriter(participant, topic, qos=RELIABLE)
            begin(writer)
            for number in range(count):
                writer.write(value(kind, number))
            # The test closes it when it has all.
            say("sent")
            sys.stdin.read()
        else:
            reader = DataReader(participant, topic, qos=RELIABLE)
            # The test sends the value -1 until one is here: before a first heartbeat, Cyclone drops
            # what a writer sends.
            next(samples(reader, 1))
            begin(reader)
            seen = 0
            while seen < count:
                sample = next(samples(reader, 1))
                if sample == value(kind, -1):
                    continue
                seen += 1
                if kind == "string":
                    say(sample.data)
                else:
                    header = sample.header
                    say([header.stamp.sec, header.stamp.nanosec, header.frame_id, sample.name,
                         sample.position, sample.velocity, sample.effort])
        return
    requests = Topic(participant, f"rq/{name}Request", Request_)
    replies = Topic(participant, f"rr/{name}Reply", Response_)
    if what == "call":
        writer = DataWriter(participant, requests, qos=RELIABLE)
        reader = DataReader(participant, replies, qos=RELIABLE)
        begin(writer, reader)
        for number in range(1, int(sys.argv[4]) + 1):
            request = Request_(guid=0x0102030405060708, seq=number, a=number, b=40)
            say(ask(writer, reader, request))
    else:
        reader = DataReader(participant, requests, qos=RELIABLE)
        writer = DataWriter(participant, replies, qos=RELIABLE)
        begin(writer, reader)
        over = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()

        def serve():
            for request in reader.take(10):
                if hasattr(request, "__dataclass_fields__"):
                    total = request.a + request.b
                    writer.write(Response_(guid=request.guid, seq=request.seq, sum=total))
            return over.is_set()

        until(serve, "the end")


# A test that has died closes nothing: then nobody waits for this one.
threading.Timer(35, lambda: os._exit(1)).start()
try:
    main()
except SystemExit as end:
    print(end, file=sys.stderr, flush=True)
    os._exit(1)
os._exit(0)
