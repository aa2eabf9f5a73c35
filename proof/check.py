"""Checks the certificate of `cargo xtask schedule --certificate` against the ELF file that it is of.

Shares no code with the analysis. Decodes the machine code with capstone, and refuses a certificate

* whose graphs are not those of the code: a block, a branch, a call or a return that is missing or differs;
* whose loops are entered in their middle, or that leaves a cycle without a bound;
* whose dual values are not what instructions, fetches, calls and iterations cost;
* whose busy windows leave out a row or a cost, whose response times are not those of the windows, or come too late.

Prints what it takes from the certificate without a check.

usage: check.py ELF CERTIFICATE (with the packages of check-requirements.txt)
"""

import contextlib
import hashlib
import json
import math
import re
import sys
from collections import Counter

import capstone
from capstone import arm
from elftools.elf.elffile import ELFFile

FORMAT = 1
# Cycles: Cortex-M4 technical reference manual (DDI 0439), tables 3-1 and 7-1, at their longest, and for floating point
# one more to wait for an operand. A certificate may have more, where a board was measured.
MANUAL = {
    "plain": 1, "multiply": 1, "divide": 12, "load": 2, "load_word": 1, "store": 2, "store_word": 1, "exclusive": 2,
    "refill": 3, "special": 2, "barrier": 4, "float_2": 2, "float_4": 4, "float_15": 15, "float_load": 2, "entry": 12,
    "exit": 12, "lazy_save": 17,
}
# The class of each instruction that is no access, the first that has its name.
CLASSES = {name: re.compile(names) for name, names in {
    "plain": r"ad[cdr]|addw|and|asr|bf[ci]|bic|clz|cm[np]|eor|ls[lr]|mov[stw]?|mvn|neg|nop|or[rn]|pkh(bt|tb)|rbit"
    r"|rev(16|sh)?|ror|rrx|rsb|sbc|[su]bfx|subw?|[su]xta?[bh](16)?|teq|tst|it|b|bl|bx|cbn?z|[su]sat|sel|clrex"
    r"|q(add|sub)|(u|s|q|uq|uh|sh)(add|sub)(8|16)",
    "multiply": r"mul|ml[as]|[us]m(ul|la)l|umaal|smml[as]r?|smmulr?|smul[btw][bt]|smla[btw][bt]",
    "divide": r"[su]div",
    "special": r"mrs|msr|cps(ie|id)?",
    "barrier": r"dsb|dmb|isb",
    "float_2": r"vabs|vadd|vsub|vneg|vn?mul|vcmpe?|vcvt[abmnpr]?|vrint.|vmov|vmrs|vmsr|fconsts|fmstat",
    "float_4": r"vn?ml[as]|vfn?m[as]",
    "float_15": r"vdiv|vsqrt",
}.items()}
MULTIPLE = re.compile(r"v?(ld|st)m(ia|db)?|v?push|v?pop|ldrd|strd|vldr|vstr")
WIDTHS = {"ldr": 4, "str": 4, "ldrb": 1, "ldrsb": 1, "strb": 1, "ldrh": 2, "ldrsh": 2, "strh": 2}
BUSES = ("sram", "ccm", "ahb", "apb1", "apb2", "usb", "private", "unknown", "uncosted")
# Flash: lines of the cache, bytes of a line, and how far ahead the processor fetches.
LINES, LINE, AHEAD = 64, 16, 12
# Cycles for a transfer that is under way, for an instruction that begins again after a preemption, and for an exclusive
# store that does so; lines that a preempted task fetches again without a cache, and that are in use with one.
TRANSFER, RESTART, RETRY, REFETCHED, IN_USE = 26, 17, 20, 2, 2
ROUNDING, MOST_JOBS, MOST_CYCLES = 1e-9, 10_000, 1e12


class Refused(Exception):
    """Why a certificate is refused."""


def need(is_so, why):
    if not is_so:
        raise Refused(why)


@contextlib.contextmanager
def about(name):
    """Says what a certificate is refused for."""
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, Refused) as why:
        raise Refused(f"{name}: {why if isinstance(why, Refused) else repr(why)}") from why


def lines_of_block(start, end):
    return set(range(start // LINE, (end - 1 + AHEAD) // LINE + 1))


class Code:
    """The machine code, and the certificate's graphs of it."""

    def __init__(self, elf, certificate):
        with open(elf, "rb") as file:
            need(hashlib.sha256(file.read()).hexdigest() == certificate["elf_sha256"], "of another ELF file")
            parsed = ELFFile(file)
            loaded = [it for it in parsed.iter_segments() if it["p_type"] == "PT_LOAD"]
            self.segments = [(it["p_vaddr"], it.data()) for it in loaded]
            symbols = parsed.get_section_by_name(".symtab")
            table = symbols.get_symbol_by_name("__vector_table")[0]["st_value"]
            self.default = symbols.get_symbol_by_name("DefaultHandler")[0]["st_value"] & ~1
            vectors = next(it for it in parsed.iter_sections() if it["sh_addr"] == table and it["sh_size"]).data()
        handlers = [int.from_bytes(vectors[at : at + 4], "little") & ~1 for at in range(0, len(vectors), 4)]
        # The first is the stack pointer, and the second the start.
        self.vectors = {table + 4 * slot: handler for slot, handler in enumerate(handlers) if slot > 1 and handler}
        self.classes, self.memory = certificate["classes"], Counter()
        self.miss, self.refill = self.classes["flash_miss"], self.classes["refill"]
        self.decoder = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
        self.decoder.detail = True
        self.functions = {int(at, 0): it for at, it in certificate["functions"].items()}
        for at, function in self.functions.items():
            with about(function["name"]):
                need(function["blocks"][0][0] == at, "does not begin at its address")
                self.check_blocks(function)
                self.check_loops(function)

    def decode(self, start, end):
        for at, data in self.segments:
            if at <= start and end <= at + len(data):
                found = list(self.decoder.disasm(data[start - at : end - at], start))
                need(found and found[-1].address + found[-1].size == end, f"no instructions up to {end:#x}")
                return found
        raise Refused(f"no code at {start:#x}")

    def check_blocks(self, function):
        """Compares the graph of a function with its code."""
        blocks, self.regions = function["blocks"], function["regions"]
        starts = {block[0] for block in blocks}
        function.update(cycles=[], floats=False, retries=False)
        for start, end, call, ends, traps, edges in blocks:
            # What does not return is no part of a certified row.
            need(not traps, f"a trap at {start:#x}")
            instructions = self.decode(start, end)
            for it in instructions:
                flow = self.flow(it, starts)
                if it is not instructions[-1]:
                    need(flow == ([[it.address + it.size, False]], None, False), f"{it.address:#x} is amid a block")
                function["floats"] |= it.insn_name()[0] in "vf"
                function["retries"] |= it.insn_name().startswith("strex")
            found = (sorted([blocks[to][0], taken] for to, taken in edges), call, ends)
            need((sorted(flow[0]), *flow[1:]) == found, f"{start:#x} goes to {flow}, not to {found}")
            function["cycles"].append(sum(self.cost(it) for it in instructions))

    def flow(self, it, starts):
        """Where execution goes after an instruction: addresses, a call, and whether the function may end."""
        name, goes_on = it.insn_name(), [[it.address + it.size, False]]
        else_on = [] if it.cc in (arm.ARM_CC_AL, arm.ARM_CC_INVALID) else goes_on
        if name in ("b", "cbz", "cbnz"):
            to = it.operands[-1].imm & 0xFFFFFFFF
            edges = else_on if name == "b" else goes_on
            need(to in starts or name == "b", f"{it.address:#x} leaves the function")
            return ([[to, True], *edges], None, False) if to in starts else (edges, to, True)
        if name == "bl":
            return goes_on, it.operands[0].imm & 0xFFFFFFFF, False
        if name == "bx" and it.operands[0].reg == arm.ARM_REG_LR:
            return else_on, None, True
        if arm.ARM_REG_PC in it.regs_access()[1] or capstone.CS_GRP_JUMP in it.groups:
            is_return = name == "pop" or name in ("ldr", "ldm") and arm.ARM_REG_SP in it.regs_access()[0]
            need(is_return, f"{it.address:#x} jumps to an unknown address: {it.mnemonic}")
            return else_on, None, True
        forbidden = ("blx", "bx", "bxj", "tbb", "tbh", "udf", "bkpt", "svc", "wfi", "wfe", "sev", "hlt")
        need(name not in forbidden, f"{it.address:#x}: {it.mnemonic}")
        return goes_on, None, False

    def cost(self, it):
        """Cycles of an instruction at the longest, without a taken branch and without its fetch."""
        of, name = self.classes, it.insn_name()
        for found, names in CLASSES.items():
            if names.fullmatch(name):
                return of["float_4" if name == "vmov" and len(it.operands) > 2 else found]
        memory = next((operand for operand in it.operands if operand.type == arm.ARM_OP_MEM), None)
        wait, is_load = self.wait(it, memory), name.startswith(("l", "vl", "pop", "vpop"))
        each = of["load_word" if is_load else "store_word"] + wait
        if re.fullmatch(r"(ld|st)rex[bh]?", name):
            return of["exclusive"] + wait
        if MULTIPLE.fullmatch(name):
            moved = [operand.reg for operand in it.operands if operand.type == arm.ARM_OP_REG]
            moved = moved[1:] if re.match("v?(ld|st)m", name) else moved
            words = len(moved) + sum(arm.ARM_REG_D0 <= reg <= arm.ARM_REG_D31 for reg in moved)
            if words > 1:
                return 1 + words * each
        need(name in WIDTHS or MULTIPLE.fullmatch(name), f"unknown instruction {name} at {it.address:#x}")
        first = of["float_load" if name[0] == "v" else "load" if is_load else "store"]
        return first + wait + (self.accesses(it, memory) - 1) * each

    def wait(self, it, memory):
        """What the bus adds to an access: to the stack and to constants amid the code, or as the certificate says."""
        region, of = self.regions.get(str(it.address), "unknown"), self.classes
        base = memory and memory.mem.base
        if base == arm.ARM_REG_SP or it.insn_name().endswith(("push", "pop")):
            need(region in ("sram", "ccm"), f"{it.address:#x}: the stack is in {region}")
        elif base == arm.ARM_REG_PC:
            need(region == "flash", f"{it.address:#x}: constants are in {region}")
        else:
            need(region == "flash" or region in BUSES, f"unknown memory {region}")
            self.memory[region] += 1
        slowest = max(of["apb1"], of["apb2"], of["flash_data"])
        return slowest if region in ("unknown", "uncosted") else of["flash_data" if region == "flash" else region]

    def accesses(self, it, memory):
        """Into how many an access is divided that is at no multiple of its length."""
        width = WIDTHS.get(it.insn_name(), 0)
        if memory is None or memory.mem.index:
            return 2 if memory and width == 2 and not memory.shift.value else 1
        at = memory.mem.disp + ((it.address + 4) & ~3 if memory.mem.base == arm.ARM_REG_PC else 0)
        return {(4, 1): 3, (4, 2): 2, (4, 3): 3, (2, 1): 2, (2, 3): 2}.get((width, at % 4), 1)

    def check_loops(self, function):
        """Loops are entered at their heads, are within each other or apart, and no other cycle is left."""
        edges, loops = [[to for to, _ in block[5]] for block in function["blocks"]], function["loops"]
        need(len({it["head"] for it in loops}) == len(loops), "two loops have one head")
        for index, it in enumerate(loops):
            head, inside, runs = it["head"], frozenset(it["blocks"]), set(it["in_runs"] or [])
            it["blocks"], it["in_runs"] = inside, runs
            need(head in inside and runs <= inside and (0 not in inside or head == 0), "a loop without its head")
            need((it["most"] is None) != (it["total"] is None), "a loop without a bound")
            need(not runs or it["total"] is not None, "runs of a loop that is not counted in all")
            for inner in (inner["blocks"] for inner in loops[:index]):
                need(inner <= inside and not inner & runs or not inner & inside, "loops that overlap")
            for block, to in ((block, to) for block, after in enumerate(edges) for to in after):
                need(block in inside or to not in inside or to == head, f"loop {head} is entered at {to}")
            # No path leads round without the blocks that count.
            work = reached = {head} if runs and head not in runs else set()
            while work:
                work = {to for block in work for to in edges[block] if to in inside - runs} - (reached - {head})
                need(head not in work, f"iterations of loop {head} that do not count")
                reached = reached | work
        function["back"] = {(block, it["head"]) for it in loops for block in it["blocks"]}
        left = {block: {to for to in after if (block, to) not in function["back"]} for block, after in enumerate(edges)}
        while done := [block for block, after in left.items() if not after & left.keys()]:
            left = {block: after for block, after in left.items() if block not in done}
        need(not left, "a cycle without a bound")


class View:
    """The longest paths of a row in one view of the cache."""

    def __init__(self, proof, given):
        self.proof, self.code, self.index, self.is_without = proof, proof.code, given["row"], given["is_without"]
        row, self.cache = proof.rows[self.index], given["cache"]
        self.numbers = row["units"]["without"] if self.is_without else proof.certificate["numbers"]
        self.given = {int(at, 0): it for at, it in given["functions"].items()}
        self.excluded, self.known, self.lines = set(row["excluded"]), {}, {}
        self.resident, self.of_line, self.of_visit, self.longest_visit = set(), 0, 0, 0
        if self.cache == "shared":
            self.resident, self.of_line, self.of_visit = proof.share(*given["resident"])
        paths = [self.function(entry) for entry in row["entries"]]
        self.cycles = max(path + sum(times * cost for times, cost in open.values()) for path, open in paths)

    def number(self, count):
        return self.numbers[count] if isinstance(count, str) else count

    def function(self, address):
        """The longest path of a function, and the budgets of its loops: times, and cycles of one."""
        if address not in self.known:
            self.known[address] = None
            with about(f"{address:#x} {self.cache}"):
                self.known[address] = self.compute(self.code.functions[address], self.given[address], address)
        need(self.known[address], "recursion")
        return self.known[address]

    def lines_of(self, address):
        """The lines of a function and of all that it calls."""
        if address not in self.lines:
            blocks = self.code.functions[address]["blocks"]
            self.lines[address] = set().union(*map(self.lines_with_call, blocks))
        return self.lines[address]

    def lines_with_call(self, block):
        called = self.lines_of(block[2]) if block[2] and block[2] not in self.excluded else set()
        return lines_of_block(*block[:2]) | called

    def visits(self, function, given):
        """The blocks of the loops whose code stays in the cache, with their heads and how many lines a visit loads."""
        of_block = {}
        for loop in function["loops"]:
            count = given["visits"].get(str(loop["head"]))
            if count is not None:
                own = [self.lines_with_call(function["blocks"][block]) for block in loop["blocks"]]
                need(len(self.resident.union(*own)) <= count <= LINES, f"a visit loads {count} lines")
                need(self.cache == "shared" and not of_block.keys() & loop["blocks"], "a visit within a visit")
                of_block.update((block, (loop["head"], count)) for block in loop["blocks"])
                self.longest_visit = max(self.longest_visit, count)
        return of_block

    def edge(self, function, of_block, before, to, taken):
        """The cost of coming to a block: of a taken branch, and of the lines that are not in the cache."""
        cost, visit, last = self.code.refill if taken else 0, of_block.get(to), of_block.get(before)
        if self.cache == "warm":
            return cost
        if visit:
            return cost + (0 if visit == last else visit[1] * self.code.miss + self.of_visit)
        lines = lines_of_block(*function["blocks"][to][:2])
        if before is not None and not taken and not last and not function["blocks"][before][2]:
            end = function["blocks"][before][1]
            lines -= lines_of_block(end - 1, end)
        return cost + len(lines) * (self.code.miss + self.of_line)

    def compute(self, function, given, address):
        blocks, of_block, budgets = function["blocks"], self.visits(function, given), {}

        def count(budget, times, cost):
            known = budgets.get(budget, (times, 0))
            need(known[0] == times, f"two numbers of the budget {budget}")
            budgets[budget] = (times, max(known[1], cost))

        costs, edges, ends = [], [], []
        for index, (_, _, call, is_end, _, after) in enumerate(blocks):
            is_out, cost = call in self.excluded, function["cycles"][index]
            if call is not None and not is_out:
                warm = index in of_block and self.proof.view(self.index, "warm", self.is_without)
                path, inner = (warm or self).function(call)
                for budget, open in inner.items():
                    count(budget, *open)
                if call in self.proof.limited:
                    count(call, self.number(self.proof.limited[call]), path + self.code.refill)
                else:
                    cost += path + self.code.refill
            elif is_end:
                cost += self.code.refill
            costs.append(cost)
            ends.append(is_end and not is_out)
            after = [] if is_out else after
            edges.append([(to, self.edge(function, of_block, index, to, taken)) for to, taken in after])
        reached = work = {0}
        while work:
            work = {to for block in work for to, _ in edges[block]} - reached
            reached = reached | work
        free, extra = set(), Counter()

        def check(rests, inside, loop):
            """Whether each dual value is the cost of its block with the greatest one behind it."""
            need(len(rests) == len(blocks), "dual values of other blocks")
            for block in inside:
                leaves = ends[block] or any(to not in inside for to, _ in edges[block])
                behind = [0] if (leaves and loop["in_runs"] if loop else ends[block]) else []
                for to, cost in edges[block]:
                    if loop and to == loop["head"]:
                        behind.append(cost)
                    elif to in inside and (block, to) not in function["back"] and rests[to] is not None:
                        behind.append(rests[to] + (0 if block in free and to in free else cost))
                more = 0 if loop and block == loop["head"] else extra[block]
                found = max(behind) + (0 if block in free else costs[block] + more) if behind else None
                why = f"{function['name']}, {self.cache}, block {block}: the dual value is {found}, not {rests[block]}"
                need(found == rests[block], why)

        for loop in function["loops"]:
            head, inside = loop["head"], loop["blocks"] & reached
            if any(to == head for block in inside for to, _ in edges[block]):
                rests = given["iterations"][str(head)]
                check(rests, inside, loop)
                if loop["total"] is None:
                    extra[head] = self.number(loop["most"]) * (rests[head] or 0)
                else:
                    budget = loop["total"] if isinstance(loop["total"], str) else (address, head)
                    count(budget, self.number(loop["total"]), rests[head] or 0)
                free |= loop["blocks"] if head in loop["in_runs"] else loop["in_runs"]
        check(given["rests"], reached, None)
        need(given["rests"][0] is not None, f"{function['name']} never returns")
        path = given["rests"][0] + self.edge(function, of_block, None, 0, False)
        need(path == given["path"], f"{function['name']}: the longest path is {path}, not {given['path']}")
        return path, budgets


class Proof:
    """The rows, their costs, and their busy windows."""

    def __init__(self, code, certificate):
        self.code, self.certificate, self.rows, self.miss = code, certificate, certificate["rows"], code.miss
        self.limited = {int(at, 0): name for at, name in certificate["limited"].items()}
        self.timed = [index for index, row in enumerate(self.rows) if "deadline" in row]
        names = ("row", "cache", "is_without", "resident")
        self.given = {json.dumps([it[name] for name in names]): it for it in certificate["views"]}
        self.views, of = {}, code.classes
        urgent = min(self.rows[index]["priority"] for index in self.timed)
        need(all(it["priority"] < urgent for it in self.rows if "deadline" not in it), "an urgent row has no deadline")
        for index in self.timed:
            row, view = self.rows[index], self.view(index, "warm")
            slots = [slot for slot, handler in code.vectors.items() if handler in row["entries"]]
            need({code.vectors[slot] for slot in slots} == set(row["entries"]), f"{row['name']} has no vector")
            row["lines"] = {slot // LINE for slot in slots}.union(*map(view.lines_of, row["entries"]))
            reached = [code.functions[it] for it in view.known]
            row["retries"] = any(it["retries"] for it in reached)
            floats = 2 * of["lazy_save"] if any(it["floats"] for it in reached) else 0
            row["frame"] = of["entry"] + of["exit"] + floats
        for it in certificate["views"]:
            self.view(*(it[name] for name in names))
        self.check_windows()

    def view(self, row, cache, is_without=False, resident=None):
        key = json.dumps([row, cache, is_without, resident])
        if key not in self.views:
            need(key in self.given, f"no view {key}")
            self.views[key] = View(self, self.given[key])
        return self.views[key]

    def share(self, warm, cold):
        """The lines of resident rows, and what other code pays for those of warm ones: by line, and by visit."""
        lines, all_lines = (set().union(*(self.rows[it]["lines"] for it in rows)) for rows in (warm, warm + cold))
        room = LINES - len(all_lines) - IN_USE
        need(room > 0, "no room in the cache")
        return all_lines, math.ceil(len(lines) * self.miss / room), len(lines) * self.miss

    def run(self, row, cache, resident=None, is_without=False):
        """Cycles of a run: the longest, or one without units of work."""
        view = self.view(row, cache, is_without, resident)
        return view.cycles + self.rows[row]["frame"] + (0 if cache == "warm" else self.miss + view.of_line)

    def parts(self, row, cache, resident):
        """Cycles of the parts of a row: of a run, and of a unit of work if their number varies."""
        run, units = self.run(row, cache, resident), self.rows[row]["units"]
        if units is None:
            return [run]
        none = self.run(row, cache, resident, True)
        unit = math.ceil(max(run - none, 0) / max(units["most"], 1))
        return [none + units["extra"] * unit, unit]

    def check_window(self, given):
        """Makes the demand of a window from the costs of the rows, and compares it and the response time."""
        rows, index, miss, derivation = self.rows, given["row"], self.miss, given["derivation"]
        own, regime, resident = rows[index], derivation["regime"], derivation["resident"]
        same = [it for it in self.timed if it != index and it not in own["exclusive_with"]]
        same = [it for it in same if rows[it]["priority"] >= own["priority"] and rows[it]["regime"] in (None, regime)]
        yielding = [it for it in same if index in rows[it]["yields_to"]]
        others = [it for it in same if it not in yielding]
        once, refetch, visit, of_visit = derivation["section"] + TRANSFER, REFETCHED * miss, 0, 0
        retries = derivation["section_retries"] or any(rows[it]["retries"] for it in [index, *same])
        restart = RESTART + (RETRY if retries or resident is None else 0)
        cache, (warm, cold) = "shared" if resident else "uncached", resident or ([], [])
        if resident:
            need(not self.certificate["prefetch"], "no line stays in the cache")
            preempting = {it for it in others if rows[it]["priority"] > own["priority"]}
            need(preempting.issuperset(warm + cold), "lines of rows that do not preempt stay in the cache")
            _, of_line, of_visit = self.share(warm, cold)
            visited = [it for it in [index, *same] if it not in warm + cold]
            visit = max(self.view(it, cache, False, resident).longest_visit for it in visited)
            once += math.ceil(derivation["section"] / miss) * of_line + of_visit
        once += max((self.run(it, cache, resident) for it in yielding), default=0)

        def costs(row):
            if rows[row]["priority"] == own["priority"]:
                return self.parts(row, cache, resident)
            if resident is None:
                return [it + restart + refetch for it in self.parts(row, cache, resident)]
            if row in warm:
                return [self.run(row, "warm") + restart]
            if row in cold:
                return [self.run(row, "uncached") + restart + refetch]
            return [self.run(row, cache, resident) + restart + refetch + visit * miss + of_visit]

        bursts, more = self.substitute(derivation, [index, *others], costs)
        streams = {it: [] for it in [index, *others]}
        for row in streams:
            for part, (stream, cost) in enumerate(zip(rows[row]["parts"], costs(row))):
                burst = stream["burst"] + (bursts.get(row, 0) if part == 0 and stream["rate"] is not None else 0)
                streams[row].append({**stream, "cost": cost, "burst": burst})
        window = {"own": streams.pop(index), "others": sum(streams.values(), []), "once": once + more}
        sort = lambda streams: sorted(json.dumps(it, sort_keys=True) for it in streams)
        need(window["own"] == given["own"] and sort(window["others"]) == sort(given["others"]), "the streams differ")
        need(window["once"] == given["once"], f"the window pays {window['once']} cycles once, not {given['once']}")
        found = response(window)
        need(found == given["response"], f"the response time is {found}, not {given['response']}")
        need(found is not None and found <= own["deadline"], "the deadline may be missed")

    def substitute(self, derivation, window, costs):
        """What the rounding of a substitution adds to bursts, and cycles; checks that its runs are paid for."""
        it = self.certificate["substitution"]
        if it is None or self.rows[it["row"]]["regime"] not in (None, derivation["regime"]):
            return {}, 0
        units, rounding = derivation["substitution"]
        allowed = [max(it["units"] - it["rounding"], 0), 0], [it["units"], it["rounding"]]
        need([units, rounding] in allowed, "another substitution")
        with_run, with_unit = ({int(row): n for row, n in it[name].items()} for name in ("with_run", "with_unit"))
        kind = unit = of_run = of_unit = 0

        def run_and_unit(row):
            run, unit = (*costs(row), 0)[:2]
            return max(run - (self.rows[row]["units"]["extra"] * unit if unit else 0), 0), unit

        for row in window:
            one, part = run_and_unit(row)
            of_run, of_unit = of_run + one * with_run.get(row, 0), of_unit + one * with_unit.get(row, 0)
            if row == it["row"]:
                kind, unit = run_and_unit(it["kind"])[0], part
        need(of_run <= units * of_unit and kind <= units * unit, "substituted runs cost more than what they replace")
        return {row: rounding * n for row, n in with_unit.items()}, rounding * unit

    def check_windows(self):
        """Checks the windows, and that there is one for each row in each regime."""
        regimes = {self.rows[it]["regime"] for it in self.timed} - {None} or {None}
        wanted = [it for it in self.timed if self.rows[it]["kind_of"] is None]
        wanted = {(it, regime) for it in wanted for regime in regimes if self.rows[it]["regime"] in (None, regime)}
        kinds = {it: self.rows[it]["kind_of"] for it in self.timed if self.rows[it]["kind_of"] is not None}
        windows, given = self.certificate["windows"], self.certificate["substitution"]
        need(kinds == ({given["kind"]: given["row"]} if given else {}), "a row without a window")
        need(wanted == {(it["row"], it["derivation"]["regime"]) for it in windows}, "a window is missing")
        for it in windows:
            with about(self.rows[it["row"]]["name"]):
                self.check_window(it)


def due(stream, time):
    """How many releases of a stream may be due in a time."""
    count = stream["group"] * math.ceil(time / stream["period"] - ROUNDING)
    if stream["rate"] is not None:
        count = min(count, math.ceil(stream["rate"] * time + stream["burst"] - ROUNDING))
    return max(count, 1)


def release(stream, job):
    """When a job of a stream is due at the earliest, from the first on."""
    spaced = job // stream["group"] * stream["period"]
    return spaced if stream["rate"] is None else max(spaced, (job - stream["burst"]) / stream["rate"])


def response(window):
    """The longest time from when a job is due to its end, or nothing."""
    *own, last = window["own"]
    longest, end = 0, window["once"]
    for job in range(MOST_JOBS):
        following = release(last, job + 1)
        fixed = window["once"] + (job + 1) * last["cost"] + sum(due(it, following) * it["cost"] for it in own)
        while (more := fixed + sum(due(it, end + it["jitter"]) * it["cost"] for it in window["others"])) > end:
            if more > MOST_CYCLES:
                return None
            end = more
        longest = max(longest, math.ceil(end - (release(last, job) - last["jitter"])))
        if end <= following - last["jitter"]:
            return longest
    return None


def taken(proof):
    """What a certificate is believed."""
    given, code, rows = proof.certificate, proof.code, [proof.rows[it] for it in proof.timed]
    buses = {name: given["classes"][name] for name in (*BUSES[:-2], "flash_data", "flash_miss")}
    yield f"{given['board']}: {given['clock_hz']} Hz; waits of buses and flash: {buses}; calls: {given['limited']}"
    yield f"substitution: {given['substitution']}"
    loops = [(it["blocks"][loop["head"]][0], loop) for it in code.functions.values() for loop in it["loops"]]
    for at, it in sorted(loops, key=lambda it: it[0]):
        count = it["total"] or it["most"]
        number = f" = {given['numbers'][count]}" if isinstance(count, str) else ""
        yield f"loop at {at:#x}: {count}{number}{'' if it['most'] else ' in all'}, by {it['origin']}"
    yield f"memory of accesses whose address is in a register: {dict(code.memory)}"
    for it in rows:
        shown = ("deadline", "parts", "priority", "regime", "exclusive_with", "yields_to", "units")
        text = ", ".join(f"{name} {it[name]}" for name in shown if it[name] not in (None, []))
        yield f"{it['name']}: {text}, without {len(it['excluded'])} functions"
    sections = {(it["derivation"]["section"], it["derivation"]["section_place"]) for it in given["windows"]}
    yield "sections that hold rows up: " + ", ".join(f"{cycles} cycles {place}" for cycles, place in sorted(sections))
    others = set(code.vectors.values()).difference([code.default], *(it["entries"] for it in rows))
    yield "less urgent, or without return: the handlers at " + ", ".join(f"{it:#x}" for it in sorted(others))


def main(elf, path):
    try:
        with about(path):
            with open(path, encoding="utf-8") as file:
                it = json.load(file)
            need(it["format"] == FORMAT, "another format")
            low = [name for name, cycles in MANUAL.items() if it["classes"][name] < cycles]
            need(not low, f"fewer cycles than the manual has: {low}")
            proof = Proof(Code(elf, it), it)
            print("taken from the certificate:", *taken(proof), sep="\n  ")
            print(f"accepted: {len(proof.timed)} rows, {len(it['functions'])} functions, {len(it['views'])} views, "
                  f"{len(it['windows'])} windows at {it['step_rate_hz']} Hz and {it['baud']} baud")
    except Refused as why:
        print(f"refused: {why}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
