// Reads a recording as Foxglove does, by its index: `node read.mjs FILE`, a message per line.
import { createHash } from 'node:crypto';
import { open } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { argv, cwd, stdout } from 'node:process';

// The packages lie where they were installed, not beside this file.
const require = createRequire(join(cwd(), 'package.json'));
const { McapIndexedReader } = require('@mcap/core');
const { loadDecompressHandlers } = require('@mcap/support');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader } = require('@foxglove/rosmsg2-serialization');

/** A message's fields as JSON; bytes by their number and their hash. */
function plain(value) {
  if (value instanceof Uint8Array) {
    return { bytes: value.length, sha1: createHash('sha1').update(value).digest('hex') };
  }
  if (typeof value === 'bigint') {
    return Number(value);
  }
  if (ArrayBuffer.isView(value) || Array.isArray(value)) {
    return Array.from(value, plain);
  }
  if (value !== null && typeof value === 'object') {
    return Object.fromEntries(Object.entries(value).map(([name, field]) => [name, plain(field)]));
  }
  return value;
}

const file = await open(argv[2], 'r');
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const block = new Uint8Array(Number(length));
    await file.read(block, 0, Number(length), Number(offset));
    return block;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  if (!decoders.has(schema.id)) {
    const text = new TextDecoder().decode(schema.data);
    decoders.set(schema.id, new MessageReader(parse(text, { ros2: true })));
  }
  const fields = plain(decoders.get(schema.id).readMessage(message.data));
  const line = [channel.topic, schema.name, String(message.logTime), fields];
  stdout.write(`${JSON.stringify(line)}\n`);
}
await file.close();
