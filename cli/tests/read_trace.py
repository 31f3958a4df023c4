"""Reads a Perfetto trace by the schema of the package `perfetto`, and prints what is in it. A part of the tests of `luna convert`."""

import gzip
import sys

from perfetto.protos.perfetto.trace import perfetto_trace_pb2 as schema

trace = schema.Trace()
with gzip.open(sys.argv[1], "rb") as file:
    trace.ParseFromString(file.read())

assert trace.packet, "there is nothing in it"
# Whatever the schema does not know stays behind as an unknown field, and is missing in what the known ones make.
assert trace.packet[0].sequence_flags & schema.TracePacket.SEQ_INCREMENTAL_STATE_CLEARED
assert all(packet.trusted_packet_sequence_id == 1 for packet in trace.packet)

tracks = {}
counters = {}
events = []
slices = []
open_slices = {}
flows = {}
# Of another program, whose recording may come later.
ends = []
default_clock = None
start = min(packet.timestamp for packet in trace.packet if packet.HasField("track_event"))
for packet in trace.packet:
    kind = packet.WhichOneof("data")
    if packet.HasField("trace_packet_defaults"):
        default_clock = packet.trace_packet_defaults.timestamp_clock_id
    assert not packet.HasField("timestamp_clock_id")
    if kind == "clock_snapshot":
        clocks = {clock.clock_id: clock.timestamp for clock in packet.clock_snapshot.clocks}
        # Without it the schema takes a time as one of BOOTTIME.
        assert default_clock == schema.BUILTIN_CLOCK_MONOTONIC
        assert set(clocks) == {schema.BUILTIN_CLOCK_MONOTONIC, schema.BUILTIN_CLOCK_REALTIME}
        assert packet.timestamp == clocks[schema.BUILTIN_CLOCK_MONOTONIC]
        assert packet.clock_snapshot.primary_trace_clock == schema.BUILTIN_CLOCK_MONOTONIC
        print("wall", clocks[schema.BUILTIN_CLOCK_REALTIME] + start - clocks[schema.BUILTIN_CLOCK_MONOTONIC])
    elif kind == "track_descriptor":
        track = packet.track_descriptor
        assert track.uuid not in tracks
        assert track.HasField("process") or track.parent_uuid in tracks
        tracks[track.uuid] = track
        if track.HasField("process"):
            print("process", track.process.pid, track.process.process_name)
        elif track.HasField("thread"):
            # Of the process that it is below.
            assert track.thread.pid == tracks[track.parent_uuid].process.pid
            print("thread", track.thread.thread_name)
        elif track.HasField("counter"):
            counters[track.uuid] = []
        else:
            print("track", track.name)
    elif kind == "track_event":
        event = packet.track_event
        at = packet.timestamp - start
        if event.type == schema.TrackEvent.TYPE_COUNTER:
            value = getattr(event, event.WhichOneof("counter_value_field"))
            counters[event.track_uuid].append(f"{at}={value}")
        elif event.type == schema.TrackEvent.TYPE_SLICE_BEGIN:
            assert event.track_uuid in tracks and event.track_uuid not in open_slices
            open_slices[event.track_uuid] = (at, event.name)
        elif event.type == schema.TrackEvent.TYPE_SLICE_END:
            began, name = open_slices.pop(event.track_uuid)
            slices.append(f"slice {tracks[event.track_uuid].name} {began}-{at} {name}")
        else:
            assert event.type == schema.TrackEvent.TYPE_INSTANT
            track = tracks[event.track_uuid]
            thread = track.thread.thread_name or track.name
            for flow in event.flow_ids:
                flows[flow] = f"{thread} {event.name}"
            for flow in event.terminating_flow_ids:
                ends.append((flow, f"{thread} {event.name}"))
            notes = ", ".join(f"{note.name}={note.string_value}" for note in event.debug_annotations)
            text = " ".join(event.name.split())
            events.append(f"instant {thread} {' '.join(event.categories)} {at} {text} ({notes})")
    else:
        sys.exit(f"unexpected: {kind}")

for uuid, values in counters.items():
    track = tracks[uuid]
    print(f"counter {track.name} [{track.counter.unit_name}]: {' '.join(values)}")
for flow, end in ends:
    slices.append(f"flow {flows.pop(flow)} -> {end}")
assert not flows
print("\n".join(slices + events))
