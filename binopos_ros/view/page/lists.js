// Lists of words: what happened, what the nodes say, what was dropped.

const SIGNS = {good: '✓', note: 'i', warning: '!', alarm: '✕'};
const GRADES = {ok: 'good', warning: 'warning', error: 'alarm', silent: 'alarm', 'no input': 'warning'};
const LONGEST = 200;

function line(grade, about, text, remedy, time) {
  const item = document.createElement('li');
  if (time) {
    const clock = document.createElement('time');
    clock.textContent = time;
    item.append(clock);
  }
  const head = document.createElement('b');
  head.dataset.grade = grade;
  head.textContent = `${SIGNS[grade]} ${about}`;
  item.append(head, text);
  if (remedy) {
    const what = document.createElement('span');
    what.className = 'remedy';
    what.textContent = remedy;
    item.append(what);
  }
  return item;
}

export function addEvents(list, events) {
  for (const {wall, grade, about, text, remedy} of events) {
    const time = new Date(wall * 1000).toLocaleTimeString('en-GB');
    list.prepend(line(grade, about, text, remedy, time));
  }
  while (list.children.length > LONGEST) list.lastChild.remove();
}

export function showNodes(list, nodes, isLive) {
  if (!nodes.length) {
    list.replaceChildren(isLive
      ? line('alarm', 'nothing heard', '', 'start binopos run; see that ROS_DOMAIN_ID and the namespace are the same here')
      : line('note', 'none', 'the bag holds no diagnostics', ''));
    return;
  }
  list.replaceChildren(...nodes.map(({name, level, message, remedy}) => line(GRADES[level], name, message, remedy)));
}

export function showDrops(list, drops) {
  if (!drops.length) list.replaceChildren(line('good', 'none', '', ''));
  else list.replaceChildren(...drops.map(({node, reason, count}) => line('note', `${count} ×`, `${reason} (${node})`, '')));
}
