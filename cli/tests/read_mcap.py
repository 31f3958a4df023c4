"""Reads an MCAP file by the packages `mcap` and `mcap-protobuf-support`, and prints its samples. A part of the tests of `luna convert`."""

import json
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if channel.message_encoding == "json":
            json.loads(message.data)
            continue
        decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
        decoded = decoder(message.data)
        value = decoded.value
        if decoded.DESCRIPTOR.fields_by_name["value"].is_repeated:
            value = list(value)
        print(f"{channel.topic} {schema.name} {value}")
