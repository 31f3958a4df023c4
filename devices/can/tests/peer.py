"""A CANopen node, or the master of one, by the package `canopen` (python-canopen), over python-can's client of socketcand.

A part of the tests of luna-can: peer.py slave|master PORT. It ends with 0 if all was as it has to be.
"""

import struct
import sys
import threading

import canopen
from canopen import objectdictionary as od

NODE = 5
LIMIT = 60
NAME = "a device of python-canopen, with a long name"
IDENTIFIER = "a simulated node of LUNA, with a long name"
PROGRAM = bytes(range(100))


def dictionary():
    objects = od.ObjectDictionary()
    objects.node_id = NODE

    def variable(name, index, kind, access="rw", default=None, sub=0):
        one = od.ODVariable(name, index, sub)
        one.data_type = kind
        one.access_type = access
        one.default = default
        return one

    for name, index, kind, access, default in [
        ("type", 0x1000, od.UNSIGNED32, "ro", 0x00020192),
        ("errors", 0x1001, od.UNSIGNED8, "ro", 0),
        ("name", 0x1008, od.VISIBLE_STRING, "ro", NAME),
        ("heartbeat", 0x1017, od.UNSIGNED16, "rw", 0),
        ("program", 0x2000, od.DOMAIN, "rw", None),
        ("secret", 0x2001, od.UNSIGNED8, "wo", 0),
        ("control", 0x6040, od.UNSIGNED16, "rw", 0),
        ("status", 0x6041, od.UNSIGNED16, "ro", 0),
        ("position", 0x6064, od.INTEGER32, "ro", 0),
        ("target", 0x607A, od.INTEGER32, "rw", 0),
    ]:
        objects.add_object(variable(name, index, kind, access, default))
    for name, index, identifier in [("RPDO", 0x1400, 0x200 + NODE), ("TPDO", 0x1800, 0x4000_0180 + NODE)]:
        communication = od.ODRecord(f"{name} communication", index)
        communication.add_member(variable("count", index, od.UNSIGNED8, "ro", 2, 0))
        communication.add_member(variable("identifier", index, od.UNSIGNED32, "rw", 0x8000_0000 | identifier, 1))
        communication.add_member(variable("transmission", index, od.UNSIGNED8, "rw", 255, 2))
        objects.add_object(communication)
        mapping = od.ODRecord(f"{name} mapping", index + 0x200)
        mapping.add_member(variable("count", index + 0x200, od.UNSIGNED8, "rw", 0, 0))
        for sub in range(1, 9):
            mapping.add_member(variable(f"entry {sub}", index + 0x200, od.UNSIGNED32, "rw", 0, sub))
        objects.add_object(mapping)
    return objects


class Waiting:
    """What callbacks report, and the main thread waits for."""

    def __init__(self):
        self.seen = []
        self.changed = threading.Condition()

    def add(self, what):
        with self.changed:
            self.seen.append(what)
            self.changed.notify_all()

    def until(self, what):
        with self.changed:
            if not self.changed.wait_for(lambda: what in self.seen, LIMIT):
                sys.exit(f"{what} did not come, but {self.seen}")
            # What came after it may be waited for next.
            del self.seen[: self.seen.index(what) + 1]


def connect(port):
    network = canopen.Network()
    network.connect(interface="socketcand", channel="luna", host="127.0.0.1", port=port)
    return network


def slave(network):
    node = canopen.LocalNode(NODE, dictionary())
    network.add_node(node)
    waiting = Waiting()

    def received(pdo):
        control, target = struct.unpack("<Hi", bytes(pdo.data[:6]))
        waiting.add((control, target))

    def commanded(identifier, data, time):
        if data[0] == 1:
            # As its object dictionary says now, which the master has written.
            node.rpdo.read()
            node.tpdo.read()
            node.rpdo[1].add_callback(received)
        waiting.add(("command", data[0]))

    network.subscribe(0, commanded)
    node.nmt.state = "INITIALISING"
    node.nmt.state = "PRE-OPERATIONAL"
    waiting.until(("command", 1))
    tpdo = node.tpdo[1]
    assert tpdo.enabled and tpdo.cob_id == 0x180 + NODE and tpdo.trans_type == 255, tpdo
    assert [(one.index, one.length) for one in tpdo.map] == [(0x6041, 16), (0x6064, 32)], tpdo.map
    waiting.until((0xF, -123456))
    # Shorter than its mapping, as it is mapped, longer.
    network.send_message(tpdo.cob_id, struct.pack("<HHB", 1, 2, 3))
    tpdo[0x6041].raw = 0x237
    tpdo[0x6064].raw = -70000
    tpdo.transmit()
    network.send_message(tpdo.cob_id, struct.pack("<HiH", 0x238, -70001, 0xFFFF))
    node.emcy.send(0x8130, 0x11, b"peer!")
    waiting.until(("command", 2))


def master(network):
    node = canopen.RemoteNode(NODE, dictionary())
    network.add_node(node)
    waiting = Waiting()
    node.nmt.add_heartbeat_callback(waiting.add)
    node.emcy.add_callback(lambda error: waiting.add(("emergency", error.code, error.register, error.data)))
    node.nmt.state = "RESET"
    waiting.until(0)
    sdo = node.sdo
    assert sdo[0x1008].raw == IDENTIFIER, sdo[0x1008].raw
    sdo[0x2000].raw = PROGRAM
    assert bytes(sdo[0x2000].raw) == PROGRAM
    for index, sub, data, code in [
        (0x5000, 0, None, 0x06020000),
        (0x1800, 9, None, 0x06090011),
        (0x2001, 0, None, 0x06010001),
        (0x6041, 0, b"\0\0", 0x06010002),
        (0x6040, 0, b"\0\0\0\0", 0x06070010),
    ]:
        try:
            sdo.upload(index, sub) if data is None else sdo.download(index, sub, data)
        except canopen.SdoAbortedError as error:
            assert error.code == code, f"{index:X}: {error}"
        else:
            sys.exit(f"{index:X}h:{sub:X}h was not refused")
    sdo[0x1017].raw = 20
    waiting.until(127)

    node.tpdo.read()
    node.rpdo.read()
    tpdo, rpdo = node.tpdo[1], node.rpdo[1]
    tpdo.clear()
    tpdo.add_variable(0x6041)
    tpdo.add_variable(0x6064)
    tpdo.trans_type, tpdo.enabled = 1, True
    rpdo.clear()
    rpdo.add_variable(0x6040)
    rpdo.add_variable(0x607A)
    rpdo.trans_type, rpdo.enabled = 255, True
    tpdo.save()
    rpdo.save()
    tpdo.add_callback(lambda pdo: waiting.add((pdo[0x6041].raw, pdo[0x6064].raw)))
    node.nmt.state = "OPERATIONAL"
    waiting.until(5)

    rpdo[0x6040].raw = 0xF
    rpdo[0x607A].raw = -123456
    rpdo.transmit()
    # The node answers by an emergency, and has new values by then.
    waiting.until(("emergency", 0x8130, 0x11, b"LUNA!"))
    network.sync.transmit()
    waiting.until((0x237, -70000))
    network.sync.transmit(count=7)
    waiting.until((0x237, -70000))
    # Longer than its mapping, then shorter: the former counts.
    network.send_message(rpdo.cob_id, struct.pack("<HiH", 0x10, -5, 0xFFFF))
    network.send_message(rpdo.cob_id, struct.pack("<HHB", 1, 2, 3))
    assert (sdo[0x6040].raw, sdo[0x607A].raw) == (0x10, -5)
    node.nmt.state = "STOPPED"
    waiting.until(4)


bus = connect(int(sys.argv[2]))
{"slave": slave, "master": master}[sys.argv[1]](bus)
bus.disconnect()
