"""A Modbus TCP server, or a client of one, by the package `pymodbus`. A part of the tests of luna-modbus.

peer.py server [UNIT]: prints its port, and serves until its input ends; its answers name UNIT, whichever was asked.
peer.py client PORT: asks, and ends with 0 if all answers are as they have to be.
"""

import asyncio
import sys

from pymodbus.client import ModbusTcpClient
from pymodbus.pdu.other_message import ReadExceptionStatusRequest
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


async def serve(unit):
    coils = [SimData(0, values=[False, False, False, True, False, False, False, False], datatype=DataType.BITS)]
    discretes = [SimData(0, values=[False, True, False, False, False, False, False, False], datatype=DataType.BITS)]
    holdings = [
        SimData(0, values=[7, 8], datatype=DataType.REGISTERS),
        SimData(2, values=[-1.5], datatype=DataType.FLOAT32),
        SimData(4, values=[0] * 200, datatype=DataType.REGISTERS),
    ]
    inputs = [
        SimData(0, values=[60000], datatype=DataType.REGISTERS),
        SimData(1, values=[-70000], datatype=DataType.INT32),
        SimData(3, values=[3000000000], datatype=DataType.UINT32),
    ]

    def named(is_sent, pdu):
        if is_sent and unit is not None:
            pdu.dev_id = unit
        return pdu

    # Device 0 stands for all.
    device = SimDevice(0, simdata=(coils, discretes, holdings, inputs))
    server = ModbusTcpServer(device, address=("127.0.0.1", 0), trace_pdu=named)
    serving = asyncio.ensure_future(server.serve_forever())
    while not (server.transport and server.transport.sockets):
        await asyncio.sleep(0)
    print(server.transport.sockets[0].getsockname()[1], flush=True)
    await asyncio.to_thread(sys.stdin.read)
    await server.shutdown()
    await serving


def ask(port):
    client = ModbusTcpClient("127.0.0.1", port=port, timeout=60)
    assert client.connect()

    def good(answer):
        assert not answer.isError(), answer
        return answer

    def refused(answer, code):
        assert answer.isError() and answer.exception_code == code, answer

    for unit in [1, 0, 255, 17]:
        at = {"device_id": unit}
        good(client.write_coil(5, True, **at))
        good(client.write_coils(8, [True, False, True, True, False, False, True, False, True, True], **at))
        bits = good(client.read_coils(5, count=13, **at)).bits[:13]
        assert bits == [True, False, False, True, False, True, True, False, False, True, False, True, True], bits
        good(client.write_coils(5, [False] * 13, **at))
        bits = good(client.read_discrete_inputs(3, count=9, **at)).bits[:9]
        assert bits == [True] + [False] * 8, bits
        good(client.write_register(10, 0xABCD, **at))
        words = list(range(1000, 1120))
        good(client.write_registers(20, words, **at))
        assert good(client.read_holding_registers(20, count=120, **at)).registers == words
        assert good(client.read_holding_registers(10, count=125, **at)).registers[:1] == [0xABCD]
        assert good(client.read_input_registers(4, count=2, **at)).registers == [0x41AC, 0]
        # No such address, and no such function.
        refused(client.read_holding_registers(999, count=2, **at), 2)
        refused(client.write_coil(1000, True, **at), 2)
        refused(client.write_registers(995, words[:10], **at), 2)
        refused(client.readwrite_registers(read_address=1, read_count=1, write_address=1, values=[1], **at), 1)
        refused(client.mask_write_register(address=1, and_mask=1, or_mask=1, **at), 1)
        refused(client.execute(False, ReadExceptionStatusRequest(dev_id=unit)), 1)
    client.close()


if sys.argv[1] == "server":
    asyncio.run(serve(int(sys.argv[2]) if len(sys.argv) > 2 else None))
else:
    ask(int(sys.argv[2]))
